//! Accounts with random passwords, which do not need a slow hash.

use crate::config::Account;
use ring::digest::{Digest, SHA256, digest};
use std::collections::HashMap;

/// Accounts of a configuration, by user name.
pub struct Keys(HashMap<Box<str>, Digest>);

impl Keys {
    /// Returns the accounts; `None` if there are none.
    pub fn new(accounts: &[Account]) -> Option<Self> {
        let keys = accounts
            .iter()
            .map(|account| {
                (
                    account.user.as_str().into(),
                    hash(account.password.as_bytes()),
                )
            })
            .collect::<HashMap<_, _>>();
        (!keys.is_empty()).then_some(Self(keys))
    }

    /// Returns whether this is the user's password. The time to compare two hashes reveals nothing about the password.
    pub fn admit(&self, user: &str, password: &[u8]) -> bool {
        let stored = self.0.get(user);
        stored.is_some_and(|stored| stored.as_ref() == hash(password).as_ref())
    }
}

fn hash(password: &[u8]) -> Digest {
    digest(&SHA256, password)
}
