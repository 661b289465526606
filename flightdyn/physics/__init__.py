"""The world as it is: rigid body and rotors, air, battery, sensors, and what fails."""
