"""Many runs, and what they say of the paper's claims."""
