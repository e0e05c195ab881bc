//! The password file: `user:hash` lines, as written by `mosquitto_passwd` and `swarmwright broker --add-user`.

use super::secret::{Costs, Secret};
use crate::{BrokerError, lines};
use std::collections::HashMap;
use std::path::Path;

/// Accounts that may connect.
pub struct Users {
    accounts: HashMap<Box<str>, Account>,
    costs: Costs,
}

struct Account {
    /// Hash as in the file, to detect changes.
    line: Box<str>,
    secret: Secret,
}

impl Users {
    /// Reads a file with lines `user:hash`.
    pub fn read(path: &Path) -> Result<Self, BrokerError> {
        let mut accounts = HashMap::new();
        let mut costs = Costs::default();
        lines::each(path, "password file", |line| {
            let Some((user, text)) = line.split_once(':').filter(|(user, _)| !user.is_empty())
            else {
                return Err(
                    "expected `user:hash`, as written by `swarmwright broker --add-user FILE NAME` or mosquitto_passwd"
                        .into(),
                );
            };
            let secret = Secret::read(text)?;
            costs.include(&secret);
            let account = Account {
                line: text.into(),
                secret,
            };
            if accounts.insert(user.into(), account).is_some() {
                return Err(format!("user {user} occurs twice; remove one of the lines"));
            }
            Ok(())
        })?;
        Ok(Self { accounts, costs })
    }

    /// Returns whether this is the user's password. The check takes the same time for existing and unknown users and
    /// all kinds of hashes, so response times do not reveal which names exist.
    pub fn admit(&self, user: &str, password: &[u8]) -> bool {
        let account = self.accounts.get(user);
        self.costs
            .check(account.map(|account| &account.secret), password)
    }

    /// Returns whether the account exists both here and in `other` with the same hash.
    pub fn is_same(&self, other: &Self, user: &str) -> bool {
        match (self.accounts.get(user), other.accounts.get(user)) {
            (Some(account), Some(other)) => account.line == other.line,
            _ => false,
        }
    }

    /// Returns whether the account exists.
    pub fn has(&self, user: &str) -> bool {
        self.accounts.contains_key(user)
    }
}
