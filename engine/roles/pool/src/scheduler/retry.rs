//! What failed: whose fault it is, what becomes of the work, who is told.

use std::time::Instant;

use crate::journal::{Attempt, Outcome};
use crate::scheduler::Scheduler;
use crate::scheduler::job::Job;
use crate::scheduler::queue::blame::{Blame, Cause, Failure, How};
use crate::scheduler::queue::piece::{Piece, Purpose};

/// How often a server may be lost with an episode that it had not begun before that counts.
const FREE_LOSSES: u32 = 3;

impl Scheduler {
    /// Jobs of a server are over without result; see [`retry`](Self::retry). The blame is the oldest one's: the others
    /// only waited.
    pub(super) fn fail_jobs(&mut self, jobs: Vec<Job>, cause: Cause<'_>, now: Instant) {
        self.fail_each(jobs, cause, now);
        self.dispatch(now);
    }

    pub(super) fn fail_each(&mut self, jobs: Vec<Job>, mut cause: Cause<'_>, now: Instant) {
        for job in jobs {
            match job {
                Job::Episode(hash) => self.fail_episode(&hash, cause, now),
                Job::Request(number) => self.fail_request(number, cause, now),
            }
            cause = cause.of_others();
        }
    }

    /// A server failed: it has a pause.
    pub(super) fn failed(&mut self, server: u64, reason: &str, now: Instant) {
        self.counts.server_failures += 1;
        self.counts.benched += 1;
        self.fleet.back_off(server, reason, now);
    }

    /// The same of a server that no other tool has: what it does not do is in vain.
    pub(super) fn failed_in_vain(&mut self, server: u64, reason: &str, now: Instant) {
        self.fleet.failed_in_vain(server);
        self.failed(server, reason, now);
    }

    /// Work that brought no result is queued again, or has failed.
    ///
    /// Where several evaluations were sent together it is unknown which one was to blame: smaller parts are tried until
    /// one is alone. What counts against that one is in [`blame`](crate::scheduler::queue::blame).
    pub(super) fn retry(
        &mut self,
        mut piece: Piece,
        server: u64,
        reason: &str,
        blame: Blame,
        now: Instant,
    ) {
        let counts = match blame {
            Blame::Gone | Blame::Lost | Blame::Silent { .. } => {
                self.lost(&piece, server, reason, blame, now)
            }
            _ => piece.len() == 1,
        };
        match piece.purpose {
            Purpose::Audit => return self.retry_audit(piece, server, reason, blame, now),
            Purpose::Probe => return self.probe_failed(server, reason, blame, now),
            Purpose::Work | Purpose::Backup => {}
        }
        let how = match blame {
            Blame::None => return self.ledger.put_back(&piece),
            Blame::Lost if !counts => return self.ledger.put_back(&piece),
            Blame::Broker => return self.ledger.put_back(&piece.halved()),
            Blame::Evaluation | Blame::Answer => How::Said,
            Blame::Crash => How::Crashed,
            Blame::Gone | Blame::Lost => How::Lost,
            Blame::Silent { .. } => {
                piece.late += 1;
                How::Lost
            }
        };
        // What it did before was a success.
        let sound =
            self.ledger.attribution().is_proven(server) && !self.fleet.health().has_failed(server);
        if how != How::Lost {
            let candidate = piece.first() / self.ledger.episodes();
            self.fleet.failed_candidate(server, candidate);
        }
        let evaluation = piece.first();
        if piece.len() == 1 && self.ledger.has_ended(evaluation) {
            return;
        }
        let piece = piece.failed(server);
        if counts {
            let failure = Failure {
                server,
                instance: self.fleet.instance(server),
                reason: reason.to_owned(),
                how,
                certain: sound && self.fleet.repeats_itself(server),
                at: now,
            };
            let attribution = self.ledger.attribution_mut();
            if attribution
                .attribute(evaluation, failure, &self.config.faults)
                .is_some()
            {
                return self.ledger.put_aside(piece);
            }
        }
        self.counts.retries += 1;
        self.ledger.put_back(&piece);
    }

    /// A server was lost, or silent for too long. Whether that counts against what it was at: it was at one evaluation
    /// alone, had succeeded with others before, and the trouble is not all servers'.
    fn lost(
        &mut self,
        piece: &Piece,
        server: u64,
        reason: &str,
        blame: Blame,
        now: Instant,
    ) -> bool {
        let evaluation = piece.first();
        let work = matches!(piece.purpose, Purpose::Work | Purpose::Backup);
        let alone = work && piece.len() == 1 && !self.ledger.has_ended(evaluation);
        let shared = self.ledger.is_shared(evaluation);
        let attribution = self.ledger.attribution_mut();
        let proven = attribution.is_proven(server);
        let together = attribution.server_lost(alone.then_some(evaluation), now);
        if !alone {
            return false;
        }
        let (times, hopeless) = attribution.lost_with(evaluation, &self.config.faults, now);
        if hopeless {
            let episodes = self.ledger.episodes();
            let (candidate, episode) = (evaluation / episodes, evaluation % episodes);
            self.outlook.cannot_decide(format!(
                "servers were lost or silent {times} times with candidate {candidate} in episode {episode}, and nothing \
                 tells whether it is the cause or the servers' surroundings are; the last time because: {reason}"
            ));
        }
        let apart = match blame {
            Blame::Silent { others } => others,
            // What has not begun may have been another tool's.
            Blame::Lost => times > FREE_LOSSES,
            _ => true,
        };
        proven && apart && !shared && !together
    }

    /// Evaluations that have failed for good.
    pub(super) fn give_up(&mut self, piece: &Piece, everywhere: bool, now: Instant) {
        for evaluation in piece.evaluations.clone() {
            let failed = self.ledger.give_up(evaluation, everywhere);
            self.counts.failed += u64::from(failed);
            if failed && everywhere {
                self.drop_copies(
                    evaluation,
                    Outcome::Dropped,
                    "the evaluation is given up",
                    now,
                );
            }
        }
    }

    /// A line of the journal.
    pub(super) fn record(
        &mut self,
        attempt: Attempt,
        piece: &Piece,
        started: Instant,
        now: Instant,
    ) {
        let (candidates, episodes) = self.ledger.extent(piece);
        let attempt = Attempt {
            candidate: candidates.start,
            candidates: candidates.len(),
            episode: episodes.start,
            episodes: episodes.len(),
            attempt: piece.tries + 1,
            seconds: now.saturating_duration_since(started).as_secs_f64(),
            ..attempt
        };
        self.journal.push(attempt, started);
    }
}
