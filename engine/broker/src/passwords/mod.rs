//! Passwords: the file of hashes, whose turn it is to be looked at, and the threads that look.
//!
//! A hash is slow on purpose, so it is never computed by the broker's own thread. Who waits for which check is the business of
//! [`Line`], which leaves room for newcomers while others guess; pairs of user and password that were right are known again at once.

mod line;
mod secret;
mod users;
mod workers;

pub use secret::{hash_for_mosquitto, hash_password};
pub use users::Users;

use line::Line;
use std::io;
use std::sync::Arc;
use std::time::Instant;
use workers::{Job, Workers};

/// What is said to a user and a password.
#[derive(Debug, PartialEq, Eq, Clone, Copy)]
pub enum Verdict {
    Admitted,
    Wrong,
    /// Too many others are ahead; this one was not looked at.
    Busy,
}

/// Everything about passwords; lives in the broker's thread.
pub struct Passwords {
    users: Arc<Users>,
    /// Counts reloads: what was looked at with an older file is looked at again.
    generation: u64,
    line: Line,
    workers: Workers,
}

impl Passwords {
    /// Starts the threads.
    pub fn new(users: Users) -> io::Result<Self> {
        let workers = Workers::start()?;
        Ok(Self {
            users: Arc::new(users),
            generation: 0,
            line: Line::new(workers.count())?,
            workers,
        })
    }

    /// What wakes the broker's thread when a check is done.
    pub fn wake_with(&mut self, wake: Box<dyn Fn() + Send>) {
        self.workers.wake_with(wake);
    }

    /// Is this the user's password? None: that is to be found out, see [`Passwords::verdicts`].
    pub fn ask(
        &mut self,
        link: usize,
        network: &str,
        user: &str,
        password: &[u8],
        now: Instant,
    ) -> Option<Verdict> {
        let pair = self.line.key(&[user.as_bytes(), password]);
        let account = self.line.key(&[user.as_bytes()]);
        if self.line.is_admitted(&pair, network, account) {
            return Some(Verdict::Admitted);
        }
        self.line.join(link, network, account, pair, now);
        None
    }

    /// The connection is gone, or has been answered.
    pub fn forget(&mut self, link: usize) {
        self.line.forget(link);
    }

    /// What has been found out for whom. `credentials`: user and password that a connection gave.
    pub fn verdicts(
        &mut self,
        now: Instant,
        credentials: impl Fn(usize) -> Option<(String, Vec<u8>)>,
    ) -> Vec<(usize, Verdict)> {
        let mut answers = Vec::new();
        for done in self.workers.done() {
            if done.generation != self.generation {
                self.line.again(&done.pair, now);
                continue;
            }
            let verdict = if done.is_right {
                Verdict::Admitted
            } else {
                Verdict::Wrong
            };
            let user = done.is_right.then_some(&*done.user);
            let waiting = self.line.ended(&done.pair, user, done.took, now);
            answers.extend(waiting.into_iter().map(|link| (link, verdict)));
        }
        let late = self.line.late(now);
        answers.extend(late.into_iter().map(|link| (link, Verdict::Busy)));
        while let Some((pair, link)) = self.line.next(now) {
            match credentials(link) {
                Some((user, password)) => self.workers.look(Job {
                    users: Arc::clone(&self.users),
                    generation: self.generation,
                    pair,
                    user,
                    password,
                }),
                None => self.line.forget(link),
            }
        }
        answers
    }

    /// When [`Passwords::verdicts`] should be asked again at the latest, though no check has ended.
    pub fn due(&self, now: Instant) -> Option<Instant> {
        self.line.due(now)
    }

    /// Other accounts; what is known of those that stay the same is kept.
    pub fn replace(&mut self, users: Users) {
        let before = std::mem::replace(&mut self.users, Arc::new(users));
        self.generation += 1;
        let after = &self.users;
        self.line.keep_admitted(|user| before.is_same(after, user));
    }

    /// The accounts that there are.
    pub fn users(&self) -> &Arc<Users> {
        &self.users
    }

    /// Forgets allowances that are full again.
    pub fn sweep(&mut self, now: Instant) {
        self.line.sweep(now);
    }
}

#[cfg(test)]
mod tests;
