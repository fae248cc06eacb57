"""What holds a piece: pegs along light rays, and where they must be for it not to sag."""
