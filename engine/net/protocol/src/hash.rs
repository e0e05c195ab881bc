//! The simulation hash, which identifies parallel episodes (D6.1 6.2, "Discovery message").

use serde_json::{Map, Value, json};
use sha2::{Digest, Sha256};

/// Hasher for the episodes of one simulation with one set of parameters.
#[derive(Debug, Clone)]
pub struct EpisodeHasher {
    /// Canonical JSON after the instance number, which comes first in the order of RFC 8785.
    rest: String,
}

impl EpisodeHasher {
    /// Creates a hasher. `simulation` is the title, `parameters` the problem-specific parameters.
    #[must_use]
    pub fn new(simulation: &str, parameters: &Map<String, Value>) -> Self {
        let whole = json!({"parameters": parameters, "simulation": simulation});
        // Canonicalization fails only for numbers that JSON cannot represent, which a Value never holds.
        let canonical =
            serde_json_canonicalizer::to_string(&whole).unwrap_or_else(|_| whole.to_string());
        Self {
            rest: format!(",{}", &canonical[1..]),
        }
    }

    /// Returns the SHA-256, as 64 hexadecimal digits, of the canonical JSON (RFC 8785) of `{"instance": ..,
    /// "parameters": {..}, "simulation": ".."}`. `instance` must be below 2^53, the limit of exact integers in JSON.
    #[must_use]
    pub fn hash(&self, instance: u64) -> String {
        use std::fmt::Write;
        let digest = Sha256::new()
            .chain_update(format!("{{\"instance\":{instance}"))
            .chain_update(&self.rest)
            .finalize();
        digest
            .iter()
            .fold(String::with_capacity(64), |mut hex, byte| {
                let _ = write!(hex, "{byte:02x}");
                hex
            })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hash_is_sha256_of_the_canonical_json() {
        let parameters = json!({"speedDefenders": 0.33, "agents": [[0.5, 3.5]], "mapWidth": 13});
        let text = r#"{"instance":42,"parameters":{"agents":[[0.5,3.5]],"mapWidth":13,"speedDefenders":0.33},"simulation":"minisim"}"#;
        let expected: String = Sha256::digest(text)
            .iter()
            .map(|byte| format!("{byte:02x}"))
            .collect();
        let hasher = EpisodeHasher::new("minisim", parameters.as_object().unwrap());
        assert_eq!(hasher.hash(42), expected);
        assert_ne!(hasher.hash(42), hasher.hash(43));
    }
}
