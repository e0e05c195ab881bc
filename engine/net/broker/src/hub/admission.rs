//! Admission of clients: unauthenticated connections, password checks, and removed accounts.

use super::Hub;
use super::complaints::Kind;
use crate::access::Access;
use crate::passwords::{Users, Verdict};
use std::collections::HashMap;
use std::net::{IpAddr, SocketAddr};
use std::time::Instant;
use swarmwright_packets::{Connect, Packet, Refusal, reason};

/// Inverse of the largest share of the permitted connections that may be unauthenticated.
const UNAUTHENTICATED_PART: usize = 2;

const WRONG: Refusal = Refusal::new(reason::BAD_PASSWORD, "wrong user name or password");
const PRIVATE: Refusal = Refusal::new(
    reason::NOT_AUTHORIZED,
    "only programs of the user who started this broker may connect, with the account that was created for it",
);
const BUSY: Refusal = Refusal::new(
    reason::BUSY,
    "many passwords are waiting to be checked; try again in a few seconds",
);

/// Returns the network of a peer: its address, or for IPv6 the 64-bit prefix, which is what a provider assigns.
pub fn network_of(peer: &str) -> Box<str> {
    let Ok(address) = peer.parse::<SocketAddr>() else {
        return peer.into();
    };
    match address.ip().to_canonical() {
        IpAddr::V4(address) => address.to_string().into(),
        IpAddr::V6(address) => {
            let [a, b, c, d, ..] = address.segments();
            format!("{a:x}:{b:x}:{c:x}:{d:x}::/64").into()
        }
    }
}

impl Hub {
    /// If there are too many unauthenticated connections, ends the oldest one of the network that has most of them.
    pub fn make_room(&mut self) {
        let clients = self.limits.clients;
        if self.unauthenticated >= (clients / UNAUTHENTICATED_PART).max(1)
            || self.links.len() >= clients
        {
            self.end_unauthenticated();
        }
    }

    /// Ends an unauthenticated connection in favour of others; returns false if there is none.
    pub fn end_unauthenticated(&mut self) -> bool {
        let unauthenticated = || {
            self.links
                .iter()
                .filter(|(_, link)| link.is_unauthenticated)
        };
        let mut networks = HashMap::<&str, usize>::new();
        for (_, link) in unauthenticated() {
            *networks.entry(&link.network).or_default() += 1;
        }
        let most = networks
            .into_iter()
            .max_by_key(|(name, count)| (*count, *name));
        let oldest = most.and_then(|(most, _)| {
            unauthenticated()
                .filter(|(_, link)| *link.network == *most)
                .min_by_key(|(_, link)| (!link.closing, link.heard))
        });
        self.dropped.extend(oldest.map(|(id, _)| id));
        oldest.is_some()
    }

    /// Checks user name and password if there are accounts; returns false while the check is running.
    pub(super) fn admit(
        &mut self,
        id: usize,
        connect: &Connect<'_>,
        now: Instant,
    ) -> Result<bool, Refusal> {
        if let Some(keys) = &self.keys {
            let is_known = connect
                .user
                .is_some_and(|user| keys.admit(user, connect.password.unwrap_or_default()));
            return if is_known || self.links[id].is_private {
                Ok(true)
            } else {
                Err(PRIVATE)
            };
        }
        let Some(passwords) = &mut self.passwords else {
            return Ok(true);
        };
        let Some(user) = connect.user else {
            return Err(Refusal::new(
                reason::NOT_AUTHORIZED,
                "this broker requires a user name and a password",
            ));
        };
        let password = connect.password.unwrap_or_default();
        let network = &self.links[id].network;
        match passwords.ask(id, network, user, password, now) {
            Some(Verdict::Admitted) => Ok(true),
            Some(Verdict::Wrong) => Err(WRONG),
            Some(Verdict::Busy) => Err(BUSY),
            None => Ok(false),
        }
    }

    /// Sets the function that wakes the broker's thread when a password has been checked.
    pub fn wake_with(&mut self, wake: Box<dyn Fn() + Send>) {
        if let Some(passwords) = &mut self.passwords {
            passwords.wake_with(wake);
        }
    }

    /// Answers clients whose passwords have been checked; returns their numbers, since they may have sent more.
    pub fn answer_checked(&mut self, now: Instant) -> Vec<usize> {
        let Some(passwords) = &mut self.passwords else {
            return Vec::new();
        };
        let links = &self.links;
        let verdicts = passwords.verdicts(now, |id| {
            let link = links.get(id)?;
            match swarmwright_packets::decode(0x10, link.asked.as_deref()?, link.terms.version) {
                Ok(Packet::Connect(connect)) => Some((
                    connect.user?.to_owned(),
                    connect.password.unwrap_or_default().to_owned(),
                )),
                _ => None,
            }
        });
        let mut answered = Vec::new();
        for (id, verdict) in verdicts {
            let Some(request) = self.links.get_mut(id).and_then(|link| link.asked.take()) else {
                continue;
            };
            self.recount(id);
            let version = self.links[id].terms.version;
            let outcome = match (
                verdict,
                swarmwright_packets::decode(0x10, &request, version),
            ) {
                (Verdict::Admitted, Ok(Packet::Connect(connect))) => self.enter(id, &connect, now),
                (Verdict::Busy, _) => Err(BUSY),
                _ => Err(WRONG),
            };
            if let Err(refusal) = outcome {
                self.refuse(id, refusal, now);
            }
            self.settle(now);
            answered.push(id);
        }
        answered
    }

    /// Returns when to call [`Hub::answer_checked`] again at the latest.
    pub fn checks_due(&self, now: Instant) -> Option<Instant> {
        self.passwords.as_ref()?.due(now)
    }

    /// Returns whether this connection's password is being checked.
    pub fn is_asking(&self, id: usize) -> bool {
        self.links.get(id).is_some_and(|link| link.asked.is_some())
    }

    /// Applies reloaded accounts and rules, and ends connections that they no longer permit.
    pub fn replace(&mut self, users: Option<Users>, access: Option<Access>, now: Instant) {
        let mut gone = Vec::new();
        if let (Some(passwords), Some(users)) = (&mut self.passwords, users) {
            let before = std::sync::Arc::clone(passwords.users());
            for (id, session) in &self.sessions {
                let user = session.user.as_deref().unwrap_or_default();
                if !users.is_same(&before, user) {
                    gone.push((id, users.has(user)));
                }
            }
            passwords.replace(users);
        }
        let is_other = access.is_some();
        if is_other {
            self.access = access;
        }
        let ended = gone.len();
        for (session, has_account) in gone {
            self.end_revoked(session, has_account, now);
        }
        if is_other {
            self.drop_unreadable();
        }
        // Cached routes depend on read access.
        self.routes.clear();
        self.settle(now);
        log::info!(
            "passwords, access rules and certificates were read again; {ended} clients were disconnected, since their accounts were removed or changed"
        );
    }

    /// Ends the connection of an account that was removed or has another password; without an account, ends the session
    /// as well.
    fn end_revoked(&mut self, session: usize, has_account: bool, now: Instant) {
        let client = self.sessions[session].client_id.clone();
        if let Some(link) = self.sessions[session].link {
            let refusal = if has_account {
                // The client may reconnect with the new password.
                Refusal::new(
                    reason::ADMINISTRATIVE,
                    "the password of its account was changed",
                )
            } else {
                Refusal::new(reason::NOT_AUTHORIZED, "its account was removed")
            };
            self.refuse(link, refusal, now);
        }
        // A session is kept for a client that may reconnect, which is impossible without an account.
        if !has_account && let Some(&existing) = self.by_client.get(&client) {
            self.end_session(existing, now);
        }
    }

    /// Drops queued messages that their clients may no longer read.
    fn drop_unreadable(&mut self) {
        let Some(access) = &self.access else {
            return;
        };
        let mut changed = Vec::new();
        for (id, session) in &mut self.sessions {
            session.keep_readable(access);
            changed.push(id);
        }
        for id in changed {
            self.recount_session(id);
        }
    }

    /// Logs that a client could not be accepted.
    pub fn report_refused(&mut self, peer: &str, why: impl std::fmt::Display, now: Instant) {
        self.complaints
            .say(Kind::Refused, now, || format!("{peer}: {why}"));
    }

    /// Takes the connections to close at once.
    pub fn take_dropped(&mut self) -> Vec<usize> {
        std::mem::take(&mut self.dropped)
    }
}

#[cfg(test)]
mod tests {
    use super::network_of;

    #[test]
    fn networks_are_addresses_or_halves_of_them() {
        for (peer, network) in [
            ("192.0.2.7:1883", "192.0.2.7"),
            ("[::ffff:192.0.2.7]:1883", "192.0.2.7"),
            ("[2001:db8:1:2:3:4:5:6]:1883", "2001:db8:1:2::/64"),
            ("[2001:db8:1:2::9]:7", "2001:db8:1:2::/64"),
        ] {
            assert_eq!(&*network_of(peer), network);
        }
    }
}
