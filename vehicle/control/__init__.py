"""What the controller of a tractor decides ten times a second: guidance, steering and speed."""
