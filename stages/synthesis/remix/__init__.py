"""One texture of several exemplars."""
