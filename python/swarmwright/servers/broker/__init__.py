"""The MQTT broker from outside: address, accounts, configuration, waiting for it, watching it."""
