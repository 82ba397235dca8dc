"""Words in messages of stages."""

OWN_STEP = "STEP"
"""stands for the name of the step that tells a message, which its flow knows, as in ``--set STEP.even=never``"""
