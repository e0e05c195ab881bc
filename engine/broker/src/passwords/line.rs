//! Whose password is looked at next, and whose not at all: no I/O, the time is told.
//!
//! Wrong passwords cost the network and the account that they came from and went to, and a share of a processor. Who has guessed
//! least is next: first by network, then by account within it; of those alike, who was told to come later and did, with the same
//! password, which a guesser has no reason to do; and the newest, since a guesser that waits for its answers is not there again
//! yet. So newcomers from another network, or of another account, are next; those who wait too long are told to come later.

use ring::hmac;
use ring::rand::SystemRandom;
use std::collections::{HashMap, HashSet, VecDeque};
use std::io;
use std::time::{Duration, Instant};

/// Wrong passwords of one network that are looked at in a second, and as many at once.
const OF_NETWORK: Rate = Rate {
    each_second: 8.0,
    most: 8.0,
};
/// Wrong passwords for one account, from networks that it has not come from before.
const OF_ACCOUNT: Rate = Rate {
    each_second: 4.0,
    most: 16.0,
};
/// Seconds of threads that wrong passwords take: half of a processor.
const OF_ALL: Rate = Rate {
    each_second: 0.5,
    most: 0.5,
};
/// How long a password waits to be looked at. Our own clients wait three seconds for an answer in MQTT 5.
const PATIENCE: Duration = Duration::from_secs(2);
/// Passwords that wait, of one network and in all; of those beyond, the oldest are told to come later.
const WAITING_OF_NETWORK: usize = 128;
const WAITING: usize = 1024;
/// How often those who wait are looked at when nothing happens.
const LOOK: Duration = Duration::from_millis(20);
/// Networks that accounts came from which are remembered, and those who were told to come later.
const TRUSTED: usize = 4096;
const RETURNING: usize = 16_384;

/// A mark that stands for a user, or for a user and a password; without the process's own secret it says nothing.
pub type Key = [u8; 32];

struct Rate {
    each_second: f64,
    most: f64,
}

/// What may be taken still; below 0 while more was taken than is allowed.
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

    fn after(&self, allowance: Option<&Allowance>, taken: f64, now: Instant) -> Allowance {
        let level = (self.level(allowance, now) - taken).min(self.most);
        Allowance { level, at: now }
    }
}

/// A user and a password that wait, for all connections that came with them.
pub struct Attempt {
    pair: Key,
    account: Key,
    network: Box<str>,
    links: Vec<usize>,
    since: Instant,
    /// Whether a thread is at it, and whether that counts for its account.
    running: bool,
    counts: bool,
    /// It was told to come later, and did.
    returns: bool,
}

/// Everybody who waits, and what is known of networks and accounts.
pub struct Line {
    secret: hmac::Key,
    /// Pairs that were right, with their user: hundreds of servers of one account come back at once.
    admitted: HashMap<Key, Box<str>>,
    /// Networks from which accounts came, with the order in which they are forgotten.
    trusted: HashSet<(Box<str>, Key)>,
    trusted_order: VecDeque<(Box<str>, Key)>,
    /// The oldest first.
    attempts: Vec<Attempt>,
    /// Those who had to make room for others.
    displaced: Vec<usize>,
    /// Pairs that were told to come later, with the order in which they are forgotten.
    returning: HashSet<Key>,
    returning_order: VecDeque<Key>,
    networks: HashMap<Box<str>, Allowance>,
    /// Of accounts within a network, and in all.
    places: HashMap<(Box<str>, Key), Allowance>,
    accounts: HashMap<Key, Allowance>,
    all: Option<Allowance>,
    workers: usize,
    running: usize,
    /// Nobody may be next before.
    look_at: Option<Instant>,
}

impl Line {
    /// Nobody waits, for so many threads.
    pub fn new(workers: usize) -> io::Result<Self> {
        let secret = hmac::Key::generate(hmac::HMAC_SHA256, &SystemRandom::new())
            .map_err(|_| io::Error::other("the operating system gives no random numbers"))?;
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
            places: HashMap::new(),
            accounts: HashMap::new(),
            all: None,
            workers,
            running: 0,
            look_at: None,
        })
    }

    /// The mark of these parts.
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

    /// Was this pair right before? Then the network is one that its account comes from.
    pub fn is_admitted(&mut self, pair: &Key, network: &str, account: Key) -> bool {
        let is_known = self.admitted.contains_key(pair);
        if is_known {
            self.trust(network, account);
        }
        is_known
    }

    /// Keeps the pairs of these users alone.
    pub fn keep_admitted(&mut self, keep: impl Fn(&str) -> bool) {
        self.admitted.retain(|_, user| keep(user));
    }

    /// A connection waits for the verdict on a pair.
    pub fn join(&mut self, link: usize, network: &str, account: Key, pair: Key, now: Instant) {
        if let Some(attempt) = self.find(&pair) {
            attempt.links.push(link);
            return;
        }
        self.look_at = None;
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
        if of_network.filter(|one| *one.network == *network).count() > WAITING_OF_NETWORK {
            self.displace(network);
        } else if self.attempts.len() > WAITING {
            let mut sizes: HashMap<&str, usize> = HashMap::new();
            for one in &self.attempts {
                *sizes.entry(&one.network).or_default() += 1;
            }
            let largest = sizes.into_iter().max_by_key(|(name, size)| (*size, *name));
            if let Some(largest) = largest.map(|(name, _)| name.to_owned()) {
                self.displace(&largest);
            }
        }
    }

    /// The oldest of a network makes room.
    fn displace(&mut self, network: &str) {
        let mut attempts = self.attempts.iter();
        let oldest = attempts.position(|one| *one.network == *network && !one.running);
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
        if self.returning_order.len() > RETURNING
            && let Some(oldest) = self.returning_order.pop_front()
        {
            self.returning.remove(&oldest);
        }
    }

    /// The connection waits no more.
    pub fn forget(&mut self, link: usize) {
        for attempt in &mut self.attempts {
            attempt.links.retain(|one| *one != link);
        }
        self.attempts
            .retain(|attempt| attempt.running || !attempt.links.is_empty());
    }

    /// The next pair to be looked at, and a connection that came with it.
    pub fn next(&mut self, now: Instant) -> Option<(Key, usize)> {
        if self.running >= self.workers || self.look_at.is_some_and(|at| now < at) {
            return None;
        }
        let Some(best) = self.best(now) else {
            self.look_at = Some(now + LOOK);
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
        if OF_ALL.level(self.all.as_ref(), now) <= 0.0 {
            return None;
        }
        let mut best: Option<(usize, (f64, f64, bool, bool))> = None;
        for (index, attempt) in self.attempts.iter().enumerate() {
            if attempt.running || attempt.links.is_empty() {
                continue;
            }
            let network = OF_NETWORK.level(self.networks.get(&attempt.network), now);
            let account = OF_ACCOUNT.level(self.accounts.get(&attempt.account), now);
            let place = (attempt.network.clone(), attempt.account);
            let is_trusted = self.trusted.contains(&place);
            if network < 1.0 || (account < 1.0 && !is_trusted) {
                continue;
            }
            let within = OF_ACCOUNT.level(self.places.get(&place), now);
            let rank = (network, within, attempt.returns, is_trusted);
            // Of two that are alike the newest, which comes last.
            if best.is_none_or(|(_, before)| rank >= before) {
                best = Some((index, rank));
            }
        }
        best.map(|(index, _)| index)
    }

    fn charge(&mut self, network: &str, account: Key, counts: bool, taken: f64, now: Instant) {
        let after = OF_NETWORK.after(self.networks.get(network), taken, now);
        self.networks.insert(network.into(), after);
        let place = (network.into(), account);
        let after = OF_ACCOUNT.after(self.places.get(&place), taken, now);
        self.places.insert(place, after);
        if counts {
            let after = OF_ACCOUNT.after(self.accounts.get(&account), taken, now);
            self.accounts.insert(account, after);
        }
    }

    /// A pair was looked at, which took so long; `user`: whose password it is, where it is right. Returns who waited for that.
    pub fn ended(
        &mut self,
        pair: &Key,
        user: Option<&str>,
        took: Duration,
        now: Instant,
    ) -> Vec<usize> {
        let mut attempts = self.attempts.iter();
        let Some(place) = attempts.position(|one| one.running && one.pair == *pair) else {
            return Vec::new();
        };
        let attempt = self.attempts.remove(place);
        self.running -= 1;
        self.look_at = None;
        match user {
            Some(user) => {
                self.charge(&attempt.network, attempt.account, attempt.counts, -1.0, now);
                self.trust(&attempt.network, attempt.account);
                self.admitted.insert(attempt.pair, user.into());
            }
            None => self.all = Some(OF_ALL.after(self.all.as_ref(), took.as_secs_f64(), now)),
        }
        attempt.links
    }

    /// A pair has to be looked at again, since the password file is another.
    pub fn again(&mut self, pair: &Key, now: Instant) {
        let mut attempts = self.attempts.iter_mut();
        if let Some(attempt) = attempts.find(|one| one.running && one.pair == *pair) {
            attempt.running = false;
            let (network, account, counts) =
                (attempt.network.clone(), attempt.account, attempt.counts);
            self.charge(&network, account, counts, -1.0, now);
            self.running -= 1;
            self.look_at = None;
        }
        self.attempts
            .retain(|attempt| attempt.running || !attempt.links.is_empty());
    }

    /// Those who have waited too long, or had to make room.
    pub fn late(&mut self, now: Instant) -> Vec<usize> {
        let mut late = std::mem::take(&mut self.displaced);
        let mut pairs = Vec::new();
        self.attempts.retain(|attempt| {
            let is_late = now.saturating_duration_since(attempt.since) >= PATIENCE;
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

    /// When to look again, where somebody waits.
    pub fn due(&self, now: Instant) -> Option<Instant> {
        let waits = self.running < self.workers && self.attempts.iter().any(|one| !one.running);
        if !self.displaced.is_empty() {
            return Some(now);
        }
        waits.then(|| self.look_at.unwrap_or(now).max(now))
    }

    fn trust(&mut self, network: &str, account: Key) {
        let known = (network.into(), account);
        if self.trusted.contains(&known) {
            return;
        }
        if self.trusted_order.len() >= TRUSTED
            && let Some(oldest) = self.trusted_order.pop_front()
        {
            self.trusted.remove(&oldest);
        }
        self.trusted.insert(known.clone());
        self.trusted_order.push_back(known);
    }

    fn find(&mut self, pair: &Key) -> Option<&mut Attempt> {
        self.attempts.iter_mut().find(|one| one.pair == *pair)
    }

    /// Forgets allowances that are full again.
    pub fn sweep(&mut self, now: Instant) {
        let is_partly = |rate: &Rate, one: &Allowance| rate.level(Some(one), now) < rate.most;
        self.networks.retain(|_, one| is_partly(&OF_NETWORK, one));
        self.places.retain(|_, one| is_partly(&OF_ACCOUNT, one));
        self.accounts.retain(|_, one| is_partly(&OF_ACCOUNT, one));
    }
}
