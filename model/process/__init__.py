"""What has nothing to do with physics: files, TOML, signals and environment variables of the process."""
