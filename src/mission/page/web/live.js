// Listens to the program that serves the page, and lets the scene be changed.
