"""Pictures and figures of loss maps."""
