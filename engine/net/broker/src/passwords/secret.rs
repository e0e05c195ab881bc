//! Password hashes in a password file: reading, checking, and creation.

use crate::BrokerError;
use argon2::{
    Algorithm, Argon2, Block, Params, Version,
    password_hash::{Output, PasswordHash, PasswordHasher, SaltString},
};
use base64::{Engine, engine::general_purpose::STANDARD};
use ring::pbkdf2;
use ring::rand::{SecureRandom, SystemRandom};
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::hint::black_box;
use std::io;
use std::num::NonZeroU32;

/// Upper limits for the parameters of argon2 and the iterations of PBKDF2; with larger ones, checking one password
/// would take all memory, or minutes of a thread.
const MOST_MEMORY: u32 = 1 << 20; // KiB
const MOST_PASSES: u32 = 100;
const MOST_ITERATIONS: u32 = 10_000_000;

/// Largest memory in KiB that a thread keeps for the next password.
const MOST_KEPT: usize = 64 << 10;

/// Number of bytes of a hash that PBKDF2 with SHA-512 computes at a time.
const BLOCK: usize = 64;
/// Largest accepted length of a hash in bytes.
const LONGEST: usize = 4 * BLOCK;

const HINT: &str =
    "write the line again with `swarmwright broker --add-user FILE NAME` or mosquitto_passwd";

/// A password hash.
pub enum Secret {
    /// `$argon2id$v=19$m=...,t=...,p=...$salt$hash`, RFC 9106.
    Argon2(Box<str>),
    /// `$7$iterations$salt$hash`: PBKDF2 with HMAC-SHA-512, as written by `mosquitto_passwd`.
    Pbkdf2 {
        iterations: NonZeroU32,
        salt: Vec<u8>,
        hash: Vec<u8>,
    },
}

impl Secret {
    /// Parses the part of a line after the user name; errors never repeat it.
    pub fn read(text: &str) -> Result<Self, String> {
        if text.starts_with("$argon2") {
            return match PasswordHash::new(text) {
                Ok(hash) if hash.salt.is_some() && hash.hash.is_some() => {
                    let most = |name, most| {
                        let value = hash.params.get_decimal(name);
                        value.is_none_or(|value| value <= most)
                    };
                    if !most("m", MOST_MEMORY) || !most("t", MOST_PASSES) {
                        return Err(format!(
                            "the argon2 hash takes more than 1 GiB or {MOST_PASSES} passes; {HINT}"
                        ));
                    }
                    Ok(Self::Argon2(text.into()))
                }
                _ => Err(format!("the argon2 hash is damaged; {HINT}")),
            };
        }
        let Some(fields) = text.strip_prefix("$7$") else {
            return Err(format!(
                "only hashes (argon2 or $7$) are accepted, not plain-text passwords; {HINT}"
            ));
        };
        let parts: Vec<&str> = fields.split('$').collect();
        let [iterations, salt, hash] = parts[..] else {
            return Err(format!("expected $7$iterations$salt$hash; {HINT}"));
        };
        let iterations = iterations
            .parse()
            .ok()
            .filter(|count: &NonZeroU32| count.get() <= MOST_ITERATIONS)
            .ok_or_else(|| {
                format!("the number of iterations must be from 1 to {MOST_ITERATIONS}; {HINT}")
            })?;
        let bytes = |text: &str| {
            STANDARD
                .decode(text)
                .map_err(|error| format!("{error}; {HINT}"))
        };
        let hash = bytes(hash)?;
        if hash.is_empty() || hash.len() > LONGEST {
            return Err(format!("the hash must have 1 to {LONGEST} bytes; {HINT}"));
        }
        Ok(Self::Pbkdf2 {
            iterations,
            salt: bytes(salt)?,
            hash,
        })
    }

    /// Returns the total iterations of PBKDF2; each block of the hash is computed separately.
    fn iterations(&self) -> u32 {
        match self {
            Self::Argon2(_) => 0,
            Self::Pbkdf2 {
                iterations, hash, ..
            } => iterations
                .get()
                .saturating_mul(u32::try_from(hash.len().div_ceil(BLOCK)).unwrap_or(u32::MAX)),
        }
    }

    /// Returns whether this is the password.
    pub fn is(&self, password: &[u8]) -> bool {
        match self {
            Self::Argon2(text) => PasswordHash::new(text).is_ok_and(|hash| {
                // The comparison takes constant time.
                hash.hash.is_some() && argon2_of(password, &hash) == hash.hash
            }),
            Self::Pbkdf2 {
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
        }
    }
}

thread_local! {
    /// Memory of argon2's last computation in this thread. If it were allocated anew each time, the system's allocator
    /// would retain several copies of it.
    static BLOCKS: RefCell<Vec<Block>> = const { RefCell::new(Vec::new()) };
}

/// Returns the hash of a password with the salt and the parameters of another hash.
fn argon2_of(password: &[u8], like: &PasswordHash) -> Option<Output> {
    let algorithm = Algorithm::try_from(like.algorithm).ok()?;
    let version = like
        .version
        .map_or(Ok(Version::default()), Version::try_from);
    let argon2 = Argon2::new(algorithm, version.ok()?, Params::try_from(like).ok()?);
    let mut bytes = [0; 64];
    let salt = like.salt?.decode_b64(&mut bytes).ok()?;
    let count = argon2.params().block_count();
    BLOCKS.with_borrow_mut(|blocks| {
        if blocks.len() != count {
            drop(std::mem::take(blocks));
            blocks.resize(count, Block::default());
        }
        let output = Output::init_with(like.hash?.len(), |out| {
            Ok(argon2.hash_password_into_with_memory(password, salt, out, &mut *blocks)?)
        });
        if count > MOST_KEPT {
            *blocks = Vec::new();
        }
        output.ok()
    })
}

/// Total computation for the hashes of a password file. Every check performs all of it, whatever the user.
#[derive(Default)]
pub struct Costs {
    /// One hash for each set of argon2's parameters, by the parameters.
    argon2: BTreeMap<String, Box<str>>,
    /// Largest number of iterations of PBKDF2 for a password.
    iterations: u32,
}

impl Costs {
    /// Includes the computation for a hash.
    pub fn include(&mut self, secret: &Secret) {
        match secret {
            Secret::Argon2(text) => {
                self.argon2
                    .entry(parameters(text))
                    .or_insert_with(|| text.clone());
            }
            Secret::Pbkdf2 { .. } => self.iterations = self.iterations.max(secret.iterations()),
        }
    }

    /// Returns whether this is the password of the secret, if there is one. The time does not depend on the secret.
    pub fn check(&self, secret: Option<&Secret>, password: &[u8]) -> bool {
        let is_right = secret.is_some_and(|secret| secret.is(password));
        let (spent, done) = match secret {
            Some(Secret::Argon2(text)) => (Some(parameters(text)), 0),
            Some(secret) => (None, secret.iterations()),
            None => (None, 0),
        };
        for (parameters, text) in &self.argon2 {
            if spent.as_ref() != Some(parameters) {
                black_box(Secret::Argon2(text.clone()).is(password));
            }
        }
        if let Some(left) = NonZeroU32::new(self.iterations.saturating_sub(done)) {
            let mut hash = [0; BLOCK];
            let algorithm = pbkdf2::PBKDF2_HMAC_SHA512;
            pbkdf2::derive(algorithm, left, b"a salt of 16 byt", password, &mut hash);
            black_box(hash);
        }
        is_right
    }
}

/// Returns the parameters of an argon2 hash: everything but salt and hash.
fn parameters(text: &str) -> String {
    let parts: Vec<&str> = text.split('$').collect();
    parts[..parts.len().saturating_sub(2)].join("$")
}

/// Returns the argon2id hash of a password with a new salt, for a password file: 19 MiB of memory, 2 passes, 1 lane,
/// the parameters that OWASP's Password Storage Cheat Sheet names first.
///
/// # Errors
/// Fails if the operating system provides no random numbers.
pub fn hash_password(password: &str) -> Result<String, BrokerError> {
    let salt: [u8; 16] = random()?;
    SaltString::encode_b64(&salt)
        .and_then(|salt| {
            Argon2::default()
                .hash_password(password.as_bytes(), &salt)
                .map(|hash| hash.to_string())
        })
        .map_err(|error| system(&error))
}

/// Returns the `$7$` hash of a password with a new salt, as read by Mosquitto 2: PBKDF2-HMAC-SHA-512 with `iterations`
/// rounds.
///
/// # Errors
/// Fails if the operating system provides no random numbers, or if there are too many iterations.
pub fn hash_for_mosquitto(password: &str, iterations: NonZeroU32) -> Result<String, BrokerError> {
    if iterations.get() > MOST_ITERATIONS {
        return Err(system(&format!(
            "at most {MOST_ITERATIONS} iterations are allowed"
        )));
    }
    let salt: [u8; 12] = random()?;
    let mut hash = [0; 64];
    pbkdf2::derive(
        pbkdf2::PBKDF2_HMAC_SHA512,
        iterations,
        &salt,
        password.as_bytes(),
        &mut hash,
    );
    Ok(format!(
        "$7${iterations}${}${}",
        STANDARD.encode(salt),
        STANDARD.encode(hash)
    ))
}

fn random<const N: usize>() -> Result<[u8; N], BrokerError> {
    let mut bytes = [0; N];
    SystemRandom::new()
        .fill(&mut bytes)
        .map_err(|_| system(&"the operating system provides no random numbers"))?;
    Ok(bytes)
}

fn system(error: &impl ToString) -> BrokerError {
    BrokerError::System {
        action: "hash the password",
        source: io::Error::other(error.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hash_that_mosquitto_passwd_wrote() {
        let hash = include_str!("../../tests/data/users")
            .lines()
            .find_map(|line| line.strip_prefix("ada:"));
        let secret = Secret::read(hash.unwrap()).unwrap();
        assert!(secret.is(b"correct horse"));
        assert!(!secret.is(b"correct horsf"));
        assert!(!secret.is(b""));
    }

    #[test]
    fn hashes_made_here_admit_their_password_alone() {
        let for_mosquitto =
            |password: &str| hash_for_mosquitto(password, NonZeroU32::new(1000).unwrap());
        for make in [hash_password, for_mosquitto] {
            let (first, second) = (make("pass:wörd").unwrap(), make("pass:wörd").unwrap());
            assert_ne!(first, second, "the salt is new every time");
            let secret = Secret::read(&first).unwrap();
            assert!(secret.is("pass:wörd".as_bytes()));
            for wrong in ["pass:word", "", "pass:wörd "] {
                assert!(!secret.is(wrong.as_bytes()));
            }
        }
    }

    /// Hashes of another implementation (OpenSSL 3) are read, whatever their cost.
    #[test]
    fn a_hash_of_another_make_with_other_parameters() {
        let secret = Secret::read(OPENSSL).unwrap();
        assert!(secret.is(b"correct horse"));
        assert!(!secret.is(b"correct horsf"));
    }

    const OPENSSL: &str = "$argon2id$v=19$m=1024,t=3,p=2$c2FsdHNhbHRzYWx0c2FsdA$it4mS7BNtvu87nsxKTLvldnWAIzKO9HoMR5I/DL6HMs";

    #[test]
    fn what_is_wrong_is_said_and_the_secret_is_not() {
        for wrong in [
            "plain password",
            "$6$salt$hash",
            "$7$101$salt",
            "$7$0$c2FsdA==$aGFzaA==",
            "$7$101$?$aGFzaA==",
            "$argon2id$v=19$m=19456,t=2,p=1$c2FsdHNhbHQ",
            "$argon2id$",
        ] {
            let message = Secret::read(wrong).err().unwrap();
            assert!(message.contains("--add-user"), "{message}");
            assert!(!message.contains(wrong), "{message}");
        }
    }
}
