"""What every stage stands on: errors, arrays, compiled loops, processes, progress, disks."""
