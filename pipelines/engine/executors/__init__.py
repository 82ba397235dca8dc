"""What computes the steps of a run: this process, processes of this machine, or a Dask cluster."""
