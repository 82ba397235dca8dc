"""The forest that detects contours."""
