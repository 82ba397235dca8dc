"""What texloom computes: kernels, analysis, synthesis, evaluation. Knows nothing of files, YAML or Prefect."""
