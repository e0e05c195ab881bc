"""Evaluation of candidates in this process, in worker processes, or on servers behind a broker."""
