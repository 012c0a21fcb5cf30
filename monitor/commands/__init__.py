"""One file per command: it reads its arguments, calls the packages and prints. No science here."""
