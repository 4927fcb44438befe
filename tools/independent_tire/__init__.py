"""A second tire, independent of the gateway's ring: a belt of finite elements with inertia, made with exudyn.

Nothing here imports the gateway, and the gateway does not need exudyn. Run: python -m independent_tire --help
"""
