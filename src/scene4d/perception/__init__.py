"""People, vehicles and the camera's orientation in pictures. Import the submodules."""
