"""Local training of one device: networks in C, torch modules and trainers of users' own."""
