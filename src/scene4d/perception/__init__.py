"""People, vehicles and the camera's orientation in images. Import the submodules."""
