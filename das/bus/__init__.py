"""The bus: messages, the registry of topics, the locked-down Zenoh session, and recordings."""
