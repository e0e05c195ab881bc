//! The password file: `user:hash` lines, as `mosquitto_passwd` and `swarmwright broker --add-user` write them.

use crate::secret::Secret;
use crate::{BrokerError, lines};
use ring::hmac;
use ring::rand::SystemRandom;
use std::collections::{HashMap, HashSet};
use std::path::Path;
use std::time::{Duration, Instant};

/// Wrong passwords that are looked at in one second; a hash costs some 20 ms of the broker's only thread.
const WRONG_PER_SECOND: u32 = 8;

/// Who may connect.
pub struct Users {
    secrets: HashMap<Box<str>, Secret>,
    /// Draws the marks in `admitted`; known to this process alone.
    key: hmac::Key,
    /// Marks of the pairs of user and password that were right, so that hundreds of servers of one account come
    /// back at once: argon2 is slow on purpose.
    admitted: HashSet<Box<[u8]>>,
    wrong: u32,
    since: Option<Instant>,
}

/// What a password file says to a user and a password.
#[derive(Debug, PartialEq, Eq, Clone, Copy)]
pub enum Verdict {
    Admitted,
    Wrong,
    /// Too many were wrong within this second; this one was not looked at.
    Later,
}

impl Users {
    /// Reads lines `user:hash`.
    pub fn read(path: &Path) -> Result<Self, BrokerError> {
        let mut secrets = HashMap::new();
        lines::each(path, "password file", |line| {
            let Some((user, secret)) = line.split_once(':').filter(|(user, _)| !user.is_empty())
            else {
                return Err(
                    "`user:hash` expected, as `swarmwright broker --add-user FILE NAME` \
                     or mosquitto_passwd writes it"
                        .into(),
                );
            };
            if secrets.insert(user.into(), Secret::read(secret)?).is_some() {
                return Err(format!("user {user} comes twice; remove one of the lines"));
            }
            Ok(())
        })?;
        let key = hmac::Key::generate(hmac::HMAC_SHA256, &SystemRandom::new()).map_err(|_| {
            BrokerError::System {
                what: "draw a random key",
                source: std::io::Error::other("the operating system gives no random numbers"),
            }
        })?;
        Ok(Self {
            secrets,
            key,
            admitted: HashSet::new(),
            wrong: 0,
            since: None,
        })
    }

    /// Is this the user's password?
    pub fn admit(&mut self, user: &str, password: &[u8], now: Instant) -> Verdict {
        let mark = self.mark(user, password);
        if self.admitted.contains(&mark) {
            return Verdict::Admitted;
        }
        if self
            .since
            .is_none_or(|since| now.saturating_duration_since(since) >= Duration::from_secs(1))
        {
            self.since = Some(now);
            self.wrong = 0;
        }
        if self.wrong >= WRONG_PER_SECOND {
            return Verdict::Later;
        }
        // A user that there is not costs as much time as one that there is: the time tells nobody which names exist.
        let (secret, exists) = match self.secrets.get(user) {
            Some(secret) => (Some(secret), true),
            None => (self.secrets.values().next(), false),
        };
        if secret.is_some_and(|secret| secret.is(password)) && exists {
            self.admitted.insert(mark);
            return Verdict::Admitted;
        }
        self.wrong += 1;
        Verdict::Wrong
    }

    fn mark(&self, user: &str, password: &[u8]) -> Box<[u8]> {
        let mut context = hmac::Context::with_key(&self.key);
        context.update(&(user.len() as u64).to_le_bytes());
        context.update(user.as_bytes());
        context.update(password);
        context.sign().as_ref().into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hash_password;

    fn users() -> Users {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("users");
        let hash = hash_password("correct horse").unwrap();
        std::fs::write(&path, format!("# the laboratory\nlab:{hash}\n")).unwrap();
        Users::read(&path).unwrap()
    }

    #[test]
    fn a_right_password_stays_right() {
        let (mut users, now) = (users(), Instant::now());
        for _ in 0..2 {
            assert_eq!(users.admit("lab", b"correct horse", now), Verdict::Admitted);
        }
        assert_eq!(users.admit("lab", b"correct hors", now), Verdict::Wrong);
        assert_eq!(users.admit("la", b"bcorrect horse", now), Verdict::Wrong);
        assert_eq!(users.admit("eve", b"correct horse", now), Verdict::Wrong);
    }

    #[test]
    fn guessing_is_slowed_down_and_keeps_nobody_out_that_was_in() {
        let (mut users, now) = (users(), Instant::now());
        assert_eq!(users.admit("lab", b"correct horse", now), Verdict::Admitted);
        for guess in 0..WRONG_PER_SECOND {
            let guess = guess.to_string();
            assert_eq!(users.admit("lab", guess.as_bytes(), now), Verdict::Wrong);
        }
        assert_eq!(users.admit("lab", b"guess", now), Verdict::Later);
        assert_eq!(users.admit("lab", b"correct horse", now), Verdict::Admitted);
        let later = now + Duration::from_secs(1);
        assert_eq!(users.admit("lab", b"guess", later), Verdict::Wrong);
    }

    #[test]
    fn what_is_wrong_names_file_and_line() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("users");
        for (text, wrong) in [
            ("\nlab:correct horse\n", "line 2"),
            ("lab\n", "line 1"),
            (":$7$1$c2FsdA==$aGFzaA==\n", "line 1"),
        ] {
            std::fs::write(&path, text).unwrap();
            let message = Users::read(&path).err().unwrap().to_string();
            assert!(
                message.contains(wrong) && message.contains("--add-user"),
                "{message}"
            );
            assert!(!message.contains("correct horse"), "{message}");
        }
    }
}
