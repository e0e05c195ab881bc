//! The password file, in the format of `mosquitto_passwd`, so that one file serves this broker and Mosquitto.

use crate::{BrokerError, lines};
use base64::{Engine, engine::general_purpose::STANDARD};
use ring::pbkdf2;
use std::collections::HashMap;
use std::num::NonZeroU32;
use std::path::Path;

/// Who may connect.
pub struct Users {
    secrets: HashMap<Box<str>, Secret>,
}

enum Secret {
    /// `$7$iterations$salt$hash`: PBKDF2 with HMAC-SHA-512.
    Hashed {
        iterations: NonZeroU32,
        salt: Vec<u8>,
        hash: Vec<u8>,
    },
    Plain(Box<str>),
}

impl Users {
    /// Reads lines `user:password` or `user:$7$iterations$salt$hash`.
    pub fn read(path: &Path) -> Result<Self, BrokerError> {
        let mut secrets = HashMap::new();
        lines::each(path, "password file", |line| {
            let Some((user, secret)) = line.split_once(':').filter(|(user, _)| !user.is_empty())
            else {
                return Err(
                    "`user:password` expected, or a line written by mosquitto_passwd".into(),
                );
            };
            if secrets.insert(user.into(), Secret::read(secret)?).is_some() {
                return Err(format!("user {user} comes twice; remove one of the lines"));
            }
            Ok(())
        })?;
        Ok(Self { secrets })
    }

    /// Is this the user's password?
    pub fn admit(&self, user: &str, password: &[u8]) -> bool {
        self.secrets
            .get(user)
            .is_some_and(|secret| secret.is(password))
    }
}

impl Secret {
    fn read(text: &str) -> Result<Self, String> {
        if !text.starts_with('$') {
            return Ok(Self::Plain(text.into()));
        }
        let hint = "write the line again with mosquitto_passwd of Mosquitto 2";
        let Some(fields) = text.strip_prefix("$7$") else {
            return Err(format!("only hashes that start with $7$ are known; {hint}"));
        };
        let parts: Vec<&str> = fields.split('$').collect();
        let [iterations, salt, hash] = parts[..] else {
            return Err(format!("$7$iterations$salt$hash expected; {hint}"));
        };
        let iterations = iterations
            .parse()
            .map_err(|_| format!("the number of iterations is wrong; {hint}"))?;
        let bytes = |text: &str| {
            STANDARD
                .decode(text)
                .map_err(|error| format!("{error}; {hint}"))
        };
        Ok(Self::Hashed {
            iterations,
            salt: bytes(salt)?,
            hash: bytes(hash)?,
        })
    }

    fn is(&self, password: &[u8]) -> bool {
        match self {
            Self::Hashed {
                iterations,
                salt,
                hash,
            } => pbkdf2::verify(
                pbkdf2::PBKDF2_HMAC_SHA512,
                *iterations,
                salt,
                password,
                hash,
            )
            .is_ok(),
            // No early end: the time taken says nothing about the password.
            Self::Plain(secret) => {
                let differences = secret
                    .bytes()
                    .zip(password)
                    .fold(0, |found, (a, b)| found | (a ^ b));
                secret.len() == password.len() && differences == 0
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hash_that_mosquitto_passwd_wrote() {
        let hash = include_str!("../tests/data/users")
            .lines()
            .find_map(|line| line.strip_prefix("ada:"));
        let secret = Secret::read(hash.unwrap()).unwrap();
        assert!(secret.is(b"correct horse"));
        assert!(!secret.is(b"correct horsf"));
        assert!(!secret.is(b""));
    }

    #[test]
    fn a_plain_password() {
        let secret = Secret::read("pass:word").unwrap();
        assert!(secret.is(b"pass:word"));
        for wrong in [&b"pass:wore"[..], b"pass:wor", b"pass:words", b""] {
            assert!(!secret.is(wrong));
        }
    }

    #[test]
    fn what_is_wrong_is_said() {
        for wrong in [
            "$6$salt$hash",
            "$7$101$salt",
            "$7$0$c2FsdA==$aGFzaA==",
            "$7$101$?$aGFzaA==",
        ] {
            let message = Secret::read(wrong).err().unwrap();
            assert!(message.contains("mosquitto_passwd"), "{message}");
        }
    }
}
