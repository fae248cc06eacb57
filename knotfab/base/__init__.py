"""What every stage builds on: errors, arrays, compiled loops, processes, progress, disks."""
