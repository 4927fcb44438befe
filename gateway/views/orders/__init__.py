"""Order spectra of wheels for people: terminal, tables and figures."""
