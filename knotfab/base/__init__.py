"""The ground of every stage: errors, arrays, compiled loops, processes, progress, disks."""
