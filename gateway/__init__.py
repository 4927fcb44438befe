"""Treadlink, the gateway between intelligent tires and the engineer's computer.

The command `treadlink` (`gateway.cli`) offers everything. Programs may use the same parts:

    gateway.io.source.open_source           bytes of a hub, the simulator or a recording
    gateway.recording.reader                recordings, read in one pass
    gateway.config.vehicle.load_vehicle     vehicle configurations
    gateway.session.batch_estimation.estimate_items    estimates of a whole recording
    gateway.session.live.LiveSession        estimates while the data arrive
    gateway.session.campaign_diagnosis      diagnosis of recordings
"""

__version__ = "0.1.0"
