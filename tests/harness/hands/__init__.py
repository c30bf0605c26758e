"""What stands in for a person's hand and for the wire of a device; shared by the tests of devices."""
