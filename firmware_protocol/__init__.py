"""The treadlink wire protocol, shared with the hub firmware."""
