"""Many runs: strategies x seeds x settings, in worker processes, into one folder of results."""
