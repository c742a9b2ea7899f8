"""Parameter sweeps: sampling, execution, reduction of results, gradients and tuning."""
