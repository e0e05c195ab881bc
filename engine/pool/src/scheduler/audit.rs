//! Results that are compared with those of another server, before they count.
//!
//! Where two servers do not agree, a third one decides: the one that stands alone is not used any more, and what it did
//! is done again.

use std::time::Instant;

use crate::scheduler::Scheduler;
use crate::scheduler::queue::piece::Piece;
use crate::scheduler::retry::Blame;
use crate::scheduler::speculation::Found;

/// Results of one evaluation that are not agreed upon yet.
#[derive(Debug, Clone)]
pub(crate) struct Check {
    first: Found,
    /// Another server's that is not the same.
    second: Option<Found>,
}

impl Check {
    fn servers(&self) -> Vec<u64> {
        let second = self.second.iter();
        std::iter::once(&self.first)
            .chain(second)
            .map(|found| found.server)
            .collect()
    }
}

/// Whether what two servers found is the same, within a tolerance where there is one.
fn same(one: &Found, other: &Found, tolerance: Option<f64>) -> bool {
    let near = |a: f64, b: f64| match tolerance {
        None => a.to_bits() == b.to_bits(),
        Some(tolerance) => (a - b).abs() <= tolerance * a.abs().max(b.abs()).max(1.0),
    };
    near(one.fitness, other.fitness)
        && one.metrics.len() == other.metrics.len()
        && one
            .metrics
            .iter()
            .zip(&other.metrics)
            .all(|(a, b)| near(*a, *b))
}

/// A share of all numbers, without a pattern that the order of the evaluations could have (`SplitMix64`).
fn is_drawn(share: f64, seed: u64, evaluation: usize) -> bool {
    let mut bits = seed.wrapping_add((evaluation as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15));
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    bits ^= bits >> 31;
    #[expect(clippy::cast_precision_loss, reason = "a share needs no more")]
    let part = (bits >> 11) as f64 / (1u64 << 53) as f64;
    part < share
}

impl Scheduler {
    pub(crate) fn is_to_be_audited(&self, evaluation: usize, server: u64) -> bool {
        let share = self.config.faults.audit;
        share > 0.0
            && is_drawn(
                share,
                self.config.first_instance ^ self.work_number,
                evaluation,
            )
            && self.fleet.is_comparable(server)
            && self.fleet.auditors_but(&[server]).is_some()
    }

    /// Has an evaluation repeated before its result counts.
    pub(crate) fn audit(&mut self, evaluation: usize, first: Found) {
        let Some(never) = self.fleet.auditors_but(&[first.server]) else {
            return;
        };
        self.counts.audits += 1;
        self.ledger.queue(Piece::audit(evaluation, never));
        self.checks.insert(
            evaluation,
            Check {
                first,
                second: None,
            },
        );
    }

    /// What another server found where a result waits for that.
    pub(crate) fn audited(&mut self, evaluation: usize, found: Found, now: Instant) {
        let Some(check) = self.checks.remove(&evaluation) else {
            self.counts.late += 1;
            return;
        };
        if check.servers().contains(&found.server) {
            self.counts.double += 1;
            self.checks.insert(evaluation, check);
            return;
        }
        let tolerance = |other: &Found| self.fleet.tolerance(other.server, found.server);
        let agrees = |other: &Found| same(other, &found, tolerance(other));
        match check.second {
            None if agrees(&check.first) => self.confirm(evaluation, &check.first, now),
            None => {
                self.counts.disagreements += 1;
                self.doubtful(evaluation, check.first, found, now);
            }
            Some(second) => match (agrees(&check.first), agrees(&second)) {
                (true, true) => self.confirm(evaluation, &check.first, now),
                (true, false) => {
                    self.confirm(evaluation, &check.first, now);
                    self.convict(evaluation, &second, &[check.first, found], now);
                }
                (false, true) => {
                    self.confirm(evaluation, &second, now);
                    self.convict(evaluation, &check.first, &[second, found], now);
                }
                (false, false) => self.disagree(evaluation, &[check.first, second, found]),
            },
        }
    }

    fn confirm(&mut self, evaluation: usize, found: &Found, now: Instant) {
        self.ledger.unqueue(evaluation);
        self.count(evaluation, found, now);
    }

    /// Two servers do not agree: a third one is asked, if there is one.
    fn doubtful(&mut self, evaluation: usize, first: Found, second: Found, now: Instant) {
        let told = self.told(evaluation, &[first.clone(), second.clone()]);
        let asked = [first.server, second.server];
        let Some(never) = self.fleet.auditors_but(&asked) else {
            return self.disagree(evaluation, &[first, second]);
        };
        self.outbox.warn(format!("{told}; a third server decides"));
        // At once: until then the one that is wrong gets more to do.
        self.ledger.queue_first(Piece::audit(evaluation, never));
        self.checks.insert(
            evaluation,
            Check {
                first,
                second: Some(second),
            },
        );
        self.dispatch(now);
    }

    /// Nobody can tell who is wrong.
    fn disagree(&mut self, evaluation: usize, found: &[Found]) {
        let told = self.told(evaluation, found);
        self.disagreement.get_or_insert(format!(
            "{told}; which one is right cannot be told without more servers that agree"
        ));
    }

    /// Who found what, in words.
    fn told(&self, evaluation: usize, found: &[Found]) -> String {
        let episodes = self.ledger.episodes();
        let (candidate, episode) = (evaluation / episodes, evaluation % episodes);
        let each: Vec<String> = found
            .iter()
            .map(|one| format!("{} on server {}", one.fitness, one.server))
            .collect();
        format!(
            "candidate {candidate} in episode {episode} has the fitness {}",
            each.join(", ")
        )
    }

    /// A server is wrong, as two others say: it is not used any more, and what it did is done again.
    fn convict(&mut self, evaluation: usize, wrong: &Found, right: &[Found], now: Instant) {
        let server = wrong.server;
        let mut found = right.to_vec();
        found.push(wrong.clone());
        let reason = format!(
            "server {server} gives wrong results and is not used any more: {}",
            self.told(evaluation, &found)
        );
        self.let_go(server);
        let jobs = self.fleet.distrust(server, &reason);
        let (reopened, lost) = self.redo(server, now);
        let handed = match lost {
            0 => String::new(),
            _ => format!("; {lost} evaluations of it had been used before and stay as they are"),
        };
        self.outbox.warn(format!(
            "{reason}; {reopened} evaluations of it are done again{handed}"
        ));
        self.fail_jobs(jobs, &reason, Blame::Nobody, now);
    }

    /// What a server did, which is not used any more, is done again. Returns how many evaluations are, and how many
    /// cannot be, since they have been handed out.
    pub(crate) fn redo(&mut self, server: u64, now: Instant) -> (usize, usize) {
        let (reopened, lost) = self.ledger.reopen(server);
        self.counts.recomputed += reopened as u64;
        let checks = std::mem::take(&mut self.checks);
        for (evaluation, check) in checks {
            let kept: Vec<Found> = std::iter::once(check.first)
                .chain(check.second)
                .filter(|found| found.server != server)
                .collect();
            match <[Found; 1]>::try_from(kept) {
                Ok([first]) => {
                    self.ledger.unqueue(evaluation);
                    self.audit(evaluation, first.clone());
                    if !self.checks.contains_key(&evaluation) {
                        self.confirm(evaluation, &first, now);
                    }
                }
                Err(kept) if kept.is_empty() => {
                    self.ledger.unqueue(evaluation);
                    self.ledger.put_back(&Piece::again(evaluation));
                }
                Err(mut both) => {
                    let second = both.pop();
                    if let Some(first) = both.pop() {
                        self.checks.insert(evaluation, Check { first, second });
                    }
                }
            }
        }
        (reopened, lost)
    }

    /// An audit brought no result: it is tried again, or left out.
    pub(crate) fn retry_audit(
        &mut self,
        piece: Piece,
        server: u64,
        reason: &str,
        blame: Blame,
        now: Instant,
    ) {
        let evaluation = piece.first();
        if !self.checks.contains_key(&evaluation) {
            return;
        }
        if matches!(blame, Blame::Nobody | Blame::Broker) {
            return self.ledger.put_back(&piece);
        }
        if piece.tries + 1 < self.config.faults.attempts {
            self.counts.retries += 1;
            return self.ledger.put_back(&piece.failed(server));
        }
        self.outbox.warn_counted(format!(
            "an audit failed after {} attempts: {reason}",
            piece.tries + 1
        ));
        self.let_pass(evaluation, now);
    }

    /// Results for which there is no second server any more count without.
    pub(crate) fn settle_unchecked(&mut self, now: Instant) {
        let alone = |check: &Check| self.fleet.auditors_but(&check.servers()).is_none();
        let unchecked: Vec<usize> = self
            .checks
            .iter()
            .filter(|(evaluation, check)| alone(check) && !self.in_flight.has(**evaluation))
            .map(|(evaluation, _)| *evaluation)
            .collect();
        for evaluation in unchecked {
            self.let_pass(evaluation, now);
        }
    }

    fn let_pass(&mut self, evaluation: usize, now: Instant) {
        let Some(check) = self.checks.remove(&evaluation) else {
            return;
        };
        match check.second {
            None => self.confirm(evaluation, &check.first, now),
            Some(second) => self.disagree(evaluation, &[check.first, second]),
        }
    }
}
