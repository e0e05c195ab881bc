//! Queue of password checks, and the decision which of them are refused unchecked; no I/O, time is an argument.
//!
//! Wrong passwords are charged to the network that they came from, to the account, and to a share of a processor.
//! Checks are ordered by the number of wrong guesses, fewest first: first of the network, then of the account within
//! the network. Among equals, pairs that were told to retry and did so with the same password come first, since an
//! attacker has no reason to repeat a guess; then the newest, since an attacker that waits for answers has not sent its
//! next guess yet. Clients from another network or of another account are therefore next. Pairs that wait too long are
//! told to retry later.

use ring::hmac;
use ring::rand::SystemRandom;
use std::collections::{HashMap, HashSet, VecDeque};
use std::io;
use std::time::{Duration, Instant};

/// Wrong passwords from one network that are checked.
const NETWORK_RATE: Rate = Rate {
    each_second: 8.0,
    most: 8.0,
};
/// Wrong passwords for one account that are checked, from networks from which it has not connected before.
const ACCOUNT_RATE: Rate = Rate {
    each_second: 4.0,
    most: 16.0,
};
/// Processor time in seconds that wrong passwords may take: half of a processor.
const TOTAL_RATE: Rate = Rate {
    each_second: 0.5,
    most: 0.5,
};
/// How long a password waits for its check. Tools and servers wait three seconds for an answer in MQTT 5.
const MAX_WAIT: Duration = Duration::from_secs(2);
/// Largest number of waiting passwords from one network and in total; beyond that, the oldest are told to retry later.
const MAX_WAITING_PER_NETWORK: usize = 128;
const MAX_WAITING: usize = 1024;
/// Interval between examinations of waiting passwords if nothing else happens.
const RECHECK_INTERVAL: Duration = Duration::from_millis(20);
/// Largest number of remembered networks from which accounts have connected, and of remembered pairs that were told to
/// retry.
const MAX_TRUSTED: usize = 4096;
const MAX_RETURNING: usize = 16_384;

/// Message authentication code of a user, or of a user and a password, with a secret of the process.
pub type Key = [u8; 32];

struct Rate {
    each_second: f64,
    most: f64,
}

/// Remainder of a rate; negative after more was taken than it allows.
#[derive(Clone, Copy)]
struct Allowance {
    level: f64,
    at: Instant,
}

impl Rate {
    fn level(&self, allowance: Option<&Allowance>, now: Instant) -> f64 {
        allowance.map_or(self.most, |allowance| {
            let passed = now.saturating_duration_since(allowance.at).as_secs_f64();
            (allowance.level + self.each_second * passed).min(self.most)
        })
    }

    fn after(&self, allowance: Option<&Allowance>, amount: f64, now: Instant) -> Allowance {
        let level = (self.level(allowance, now) - amount).min(self.most);
        Allowance { level, at: now }
    }
}

/// A waiting pair of user and password, with all connections that sent it.
pub struct Attempt {
    pair: Key,
    account: Key,
    network: Box<str>,
    links: Vec<usize>,
    since: Instant,
    /// Whether a thread is checking the pair, and whether the check counts for its account.
    running: bool,
    counts: bool,
    /// Whether the pair was told to retry later and did.
    returns: bool,
}

/// All waiting pairs, and the state of networks and accounts.
pub struct CheckQueue {
    secret: hmac::Key,
    /// Accepted pairs with their user; hundreds of servers with one account may reconnect at the same time.
    admitted: HashMap<Key, Box<str>>,
    /// Networks from which accounts have connected, and the order in which they are removed.
    trusted: HashSet<(Box<str>, Key)>,
    trusted_order: VecDeque<(Box<str>, Key)>,
    /// Waiting pairs, the oldest first.
    attempts: Vec<Attempt>,
    /// Connections whose pairs were displaced by others.
    displaced: Vec<usize>,
    /// Pairs that were told to retry later, and the order in which they are removed.
    returning: HashSet<Key>,
    returning_order: VecDeque<Key>,
    networks: HashMap<Box<str>, Allowance>,
    /// Allowances of accounts within a network, and in total.
    origins: HashMap<(Box<str>, Key), Allowance>,
    accounts: HashMap<Key, Allowance>,
    all: Option<Allowance>,
    workers: usize,
    running: usize,
    /// Time before which no pair can be next.
    recheck_at: Option<Instant>,
}

impl CheckQueue {
    /// Creates an empty queue for this number of threads.
    pub fn new(workers: usize) -> io::Result<Self> {
        let secret = hmac::Key::generate(hmac::HMAC_SHA256, &SystemRandom::new())
            .map_err(|_| io::Error::other("the operating system provides no random numbers"))?;
        Ok(Self {
            secret,
            admitted: HashMap::new(),
            trusted: HashSet::new(),
            trusted_order: VecDeque::new(),
            attempts: Vec::new(),
            displaced: Vec::new(),
            returning: HashSet::new(),
            returning_order: VecDeque::new(),
            networks: HashMap::new(),
            origins: HashMap::new(),
            accounts: HashMap::new(),
            all: None,
            workers,
            running: 0,
            recheck_at: None,
        })
    }

    /// Returns the message authentication code of these parts.
    pub fn key(&self, parts: &[&[u8]]) -> Key {
        let mut context = hmac::Context::with_key(&self.secret);
        for part in parts {
            context.update(&(part.len() as u64).to_le_bytes());
            context.update(part);
        }
        let mut key = Key::default();
        key.copy_from_slice(context.sign().as_ref());
        key
    }

    /// Returns whether this pair was accepted before; if so, its account is trusted on this network.
    pub fn is_admitted(&mut self, pair: &Key, network: &str, account: Key) -> bool {
        let is_known = self.admitted.contains_key(pair);
        if is_known {
            self.trust(network, account);
        }
        is_known
    }

    /// Keeps only the accepted pairs of these users.
    pub fn keep_admitted(&mut self, keep: impl Fn(&str) -> bool) {
        self.admitted.retain(|_, user| keep(user));
    }

    /// Adds a connection that waits for the check of a pair.
    pub fn join(&mut self, link: usize, network: &str, account: Key, pair: Key, now: Instant) {
        if let Some(attempt) = self.find(&pair) {
            attempt.links.push(link);
            return;
        }
        self.recheck_at = None;
        let returns = self.returning.contains(&pair);
        self.attempts.push(Attempt {
            returns,
            pair,
            account,
            network: network.into(),
            links: vec![link],
            since: now,
            running: false,
            counts: false,
        });
        let of_network = self.attempts.iter();
        if of_network
            .filter(|attempt| *attempt.network == *network)
            .count()
            > MAX_WAITING_PER_NETWORK
        {
            self.displace(network);
        } else if self.attempts.len() > MAX_WAITING {
            let mut sizes: HashMap<&str, usize> = HashMap::new();
            for attempt in &self.attempts {
                *sizes.entry(&attempt.network).or_default() += 1;
            }
            let largest = sizes.into_iter().max_by_key(|(name, size)| (*size, *name));
            if let Some(largest) = largest.map(|(name, _)| name.to_owned()) {
                self.displace(&largest);
            }
        }
    }

    /// Removes the oldest waiting pair of a network.
    fn displace(&mut self, network: &str) {
        let mut attempts = self.attempts.iter();
        let oldest = attempts.position(|attempt| *attempt.network == *network && !attempt.running);
        if let Some(oldest) = oldest {
            let attempt = self.attempts.remove(oldest);
            self.note_returning(attempt.pair);
            self.displaced.extend(attempt.links);
        }
    }

    fn note_returning(&mut self, pair: Key) {
        if !self.returning.insert(pair) {
            return;
        }
        self.returning_order.push_back(pair);
        if self.returning_order.len() > MAX_RETURNING
            && let Some(oldest) = self.returning_order.pop_front()
        {
            self.returning.remove(&oldest);
        }
    }

    /// Removes a connection that no longer waits.
    pub fn forget(&mut self, link: usize) {
        for attempt in &mut self.attempts {
            attempt.links.retain(|other| *other != link);
        }
        self.attempts
            .retain(|attempt| attempt.running || !attempt.links.is_empty());
    }

    /// Returns the next pair to check, and a connection that sent it.
    pub fn next(&mut self, now: Instant) -> Option<(Key, usize)> {
        if self.running >= self.workers || self.recheck_at.is_some_and(|at| now < at) {
            return None;
        }
        let Some(best) = self.best(now) else {
            self.recheck_at = Some(now + RECHECK_INTERVAL);
            return None;
        };
        let attempt = &mut self.attempts[best];
        let link = *attempt.links.first()?;
        attempt.running = true;
        attempt.counts = !self
            .trusted
            .contains(&(attempt.network.clone(), attempt.account));
        self.running += 1;
        let (network, account, counts) = (attempt.network.clone(), attempt.account, attempt.counts);
        let pair = attempt.pair;
        self.charge(&network, account, counts, 1.0, now);
        Some((pair, link))
    }

    fn best(&self, now: Instant) -> Option<usize> {
        if TOTAL_RATE.level(self.all.as_ref(), now) <= 0.0 {
            return None;
        }
        let mut best: Option<(usize, (f64, f64, bool, bool))> = None;
        for (index, attempt) in self.attempts.iter().enumerate() {
            if attempt.running || attempt.links.is_empty() {
                continue;
            }
            let network = NETWORK_RATE.level(self.networks.get(&attempt.network), now);
            let account = ACCOUNT_RATE.level(self.accounts.get(&attempt.account), now);
            let origin = (attempt.network.clone(), attempt.account);
            let is_trusted = self.trusted.contains(&origin);
            if network < 1.0 || (account < 1.0 && !is_trusted) {
                continue;
            }
            let within = ACCOUNT_RATE.level(self.origins.get(&origin), now);
            let rank = (network, within, attempt.returns, is_trusted);
            // Prefer the newest of equals, which is later in the list.
            if best.is_none_or(|(_, before)| rank >= before) {
                best = Some((index, rank));
            }
        }
        best.map(|(index, _)| index)
    }

    fn charge(&mut self, network: &str, account: Key, counts: bool, amount: f64, now: Instant) {
        let after = NETWORK_RATE.after(self.networks.get(network), amount, now);
        self.networks.insert(network.into(), after);
        let origin = (network.into(), account);
        let after = ACCOUNT_RATE.after(self.origins.get(&origin), amount, now);
        self.origins.insert(origin, after);
        if counts {
            let after = ACCOUNT_RATE.after(self.accounts.get(&account), amount, now);
            self.accounts.insert(account, after);
        }
    }

    /// Records the end of a check. `took`: processor time; `user`: the user if the password is right. Returns the
    /// waiting connections.
    pub fn ended(
        &mut self,
        pair: &Key,
        user: Option<&str>,
        took: Duration,
        now: Instant,
    ) -> Vec<usize> {
        let mut attempts = self.attempts.iter();
        let Some(index) = attempts.position(|attempt| attempt.running && attempt.pair == *pair)
        else {
            return Vec::new();
        };
        let attempt = self.attempts.remove(index);
        self.running -= 1;
        self.recheck_at = None;
        match user {
            Some(user) => {
                self.charge(&attempt.network, attempt.account, attempt.counts, -1.0, now);
                self.trust(&attempt.network, attempt.account);
                self.admitted.insert(attempt.pair, user.into());
            }
            None => self.all = Some(TOTAL_RATE.after(self.all.as_ref(), took.as_secs_f64(), now)),
        }
        attempt.links
    }

    /// Queues a pair again, because the password file has changed.
    pub fn repeat(&mut self, pair: &Key, now: Instant) {
        let mut attempts = self.attempts.iter_mut();
        if let Some(attempt) = attempts.find(|attempt| attempt.running && attempt.pair == *pair) {
            attempt.running = false;
            let (network, account, counts) =
                (attempt.network.clone(), attempt.account, attempt.counts);
            self.charge(&network, account, counts, -1.0, now);
            self.running -= 1;
            self.recheck_at = None;
        }
        self.attempts
            .retain(|attempt| attempt.running || !attempt.links.is_empty());
    }

    /// Takes the connections that have waited too long or were displaced.
    pub fn late(&mut self, now: Instant) -> Vec<usize> {
        let mut late = std::mem::take(&mut self.displaced);
        let mut pairs = Vec::new();
        self.attempts.retain(|attempt| {
            let is_late = now.saturating_duration_since(attempt.since) >= MAX_WAIT;
            if is_late && !attempt.running {
                late.extend(&attempt.links);
                pairs.push(attempt.pair);
            }
            attempt.running || !is_late
        });
        for pair in pairs {
            self.note_returning(pair);
        }
        late
    }

    /// Returns when to examine the queue again, if a pair waits.
    pub fn due(&self, now: Instant) -> Option<Instant> {
        let waits =
            self.running < self.workers && self.attempts.iter().any(|attempt| !attempt.running);
        if !self.displaced.is_empty() {
            return Some(now);
        }
        waits.then(|| self.recheck_at.unwrap_or(now).max(now))
    }

    fn trust(&mut self, network: &str, account: Key) {
        let origin = (network.into(), account);
        if self.trusted.contains(&origin) {
            return;
        }
        if self.trusted_order.len() >= MAX_TRUSTED
            && let Some(oldest) = self.trusted_order.pop_front()
        {
            self.trusted.remove(&oldest);
        }
        self.trusted.insert(origin.clone());
        self.trusted_order.push_back(origin);
    }

    fn find(&mut self, pair: &Key) -> Option<&mut Attempt> {
        self.attempts
            .iter_mut()
            .find(|attempt| attempt.pair == *pair)
    }

    /// Removes allowances that are full again.
    pub fn sweep(&mut self, now: Instant) {
        let is_partly =
            |rate: &Rate, allowance: &Allowance| rate.level(Some(allowance), now) < rate.most;
        self.networks
            .retain(|_, allowance| is_partly(&NETWORK_RATE, allowance));
        self.origins
            .retain(|_, allowance| is_partly(&ACCOUNT_RATE, allowance));
        self.accounts
            .retain(|_, allowance| is_partly(&ACCOUNT_RATE, allowance));
    }
}
