"""Several records of one machine: what each kind gives, and one estimate of all."""
