"""Private helpers of the stage that makes texture on a surface."""
