//! Typed messages to bytes and back, topics, hashes, validation.
