"""Where candidates are evaluated: in this process, in processes started here, or through a broker."""
