"""The treadlink wire protocol, owned together with the hub firmware."""
