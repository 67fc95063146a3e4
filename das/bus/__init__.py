"""The bus: messages, the registry of topics, the locked-down Zenoh session, the recorder."""
