//! The MQTT connection of the optimization tool and of the simulation wrapper.
