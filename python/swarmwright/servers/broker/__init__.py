"""Access to MQTT brokers: address, accounts, configuration, connection and observation."""
