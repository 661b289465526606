"""What is to be flown: a round's plan or a plan file, as mission items, path and fence."""
