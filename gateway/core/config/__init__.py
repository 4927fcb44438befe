"""Vehicle configuration: one TOML file, validated whole."""
