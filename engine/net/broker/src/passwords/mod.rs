//! Passwords: the file of hashes, the order of checks, and the threads that check them.
//!
//! Password hashes are deliberately slow, so the broker's event loop never computes one. [`CheckQueue`] orders the
//! checks so that clients can log in while others guess; pairs of user and password that were right before are accepted
//! at once.

mod keys;
mod queue;
mod secret;
mod users;
mod workers;

pub use keys::Keys;
pub use secret::{hash_for_mosquitto, hash_password};
pub use users::Users;

use queue::CheckQueue;
use std::io;
use std::sync::Arc;
use std::time::Instant;
use workers::{Job, Workers};

/// Result of checking a user and a password.
#[derive(Debug, PartialEq, Eq, Clone, Copy)]
pub enum Verdict {
    Admitted,
    Wrong,
    /// The password was not checked, because too many others were waiting.
    Busy,
}

/// State of all password checks, owned by the broker's thread.
pub struct Passwords {
    users: Arc<Users>,
    /// Number of reloads; results for an older file are discarded and checked again.
    generation: u64,
    queue: CheckQueue,
    workers: Workers,
}

impl Passwords {
    /// Starts the threads.
    pub fn new(users: Users) -> io::Result<Self> {
        let workers = Workers::start()?;
        Ok(Self {
            users: Arc::new(users),
            generation: 0,
            queue: CheckQueue::new(workers.count())?,
            workers,
        })
    }

    /// Sets the function that wakes the broker's thread when a check is done.
    pub fn wake_with(&mut self, wake: Box<dyn Fn() + Send>) {
        self.workers.wake_with(wake);
    }

    /// Checks a password. Returns `None` if the hash must be computed, see [`Passwords::verdicts`].
    pub fn ask(
        &mut self,
        link: usize,
        network: &str,
        user: &str,
        password: &[u8],
        now: Instant,
    ) -> Option<Verdict> {
        let pair = self.queue.key(&[user.as_bytes(), password]);
        let account = self.queue.key(&[user.as_bytes()]);
        if self.queue.is_admitted(&pair, network, account) {
            return Some(Verdict::Admitted);
        }
        self.queue.join(link, network, account, pair, now);
        None
    }

    /// Removes a connection that has ended or has been answered.
    pub fn forget(&mut self, link: usize) {
        self.queue.forget(link);
    }

    /// Returns the results of checks, by connection. `credentials` returns user and password that a connection sent.
    pub fn verdicts(
        &mut self,
        now: Instant,
        credentials: impl Fn(usize) -> Option<(String, Vec<u8>)>,
    ) -> Vec<(usize, Verdict)> {
        let mut answers = Vec::new();
        for done in self.workers.done() {
            if done.generation != self.generation {
                self.queue.repeat(&done.pair, now);
                continue;
            }
            let verdict = if done.is_right {
                Verdict::Admitted
            } else {
                Verdict::Wrong
            };
            let user = done.is_right.then_some(&*done.user);
            let waiting = self.queue.ended(&done.pair, user, done.took, now);
            answers.extend(waiting.into_iter().map(|link| (link, verdict)));
        }
        let late = self.queue.late(now);
        answers.extend(late.into_iter().map(|link| (link, Verdict::Busy)));
        while let Some((pair, link)) = self.queue.next(now) {
            match credentials(link) {
                Some((user, password)) => self.workers.look(Job {
                    users: Arc::clone(&self.users),
                    generation: self.generation,
                    pair,
                    user,
                    password,
                }),
                None => self.queue.forget(link),
            }
        }
        answers
    }

    /// Returns when to call [`Passwords::verdicts`] again at the latest, even if no check has ended.
    pub fn due(&self, now: Instant) -> Option<Instant> {
        self.queue.due(now)
    }

    /// Replaces the accounts; accepted pairs of unchanged accounts are kept.
    pub fn replace(&mut self, users: Users) {
        let before = std::mem::replace(&mut self.users, Arc::new(users));
        self.generation += 1;
        let after = &self.users;
        self.queue.keep_admitted(|user| before.is_same(after, user));
    }

    /// Returns the current accounts.
    pub fn users(&self) -> &Arc<Users> {
        &self.users
    }

    /// Removes allowances that are full again.
    pub fn sweep(&mut self, now: Instant) {
        self.queue.sweep(now);
    }
}

#[cfg(test)]
mod tests;
