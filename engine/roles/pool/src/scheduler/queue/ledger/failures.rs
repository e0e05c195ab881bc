//! Handling of work that returned no result, and what counts against it.

use std::time::Instant;

use super::Ledger;
use crate::scheduler::queue::blame::{Blame, Failure, FailureKind};
use crate::scheduler::queue::piece::{Piece, Purpose};
use crate::sections::Faults;

/// Number of losses before an episode has begun that do not count.
const FREE_LOSSES: u32 = 3;

/// A piece that a server did not evaluate.
pub(crate) struct Failed<'a> {
    pub server: u64,
    /// Instance of the server, if it announces one.
    pub instance: Option<String>,
    pub reason: &'a str,
    pub blame: Blame,
    /// Whether the server has no recent failures and is bitwise deterministic.
    pub sound: bool,
    pub at: Instant,
}

/// What the loss of a server says about its evaluation.
#[derive(Debug, Default, PartialEq, Eq)]
pub(crate) struct Loss {
    /// Whether the loss counts against the evaluation.
    pub counts: bool,
    /// Number of losses with the evaluation, if it is undecidable whether the evaluation is the cause.
    pub hopeless: Option<u32>,
}

impl Ledger {
    /// Records that a server was lost or silent for too long. The loss counts against its evaluation if the server had
    /// only one, had succeeded with others before, and no common cause affects several servers.
    pub fn lost(
        &mut self,
        piece: &Piece,
        server: u64,
        blame: Blame,
        faults: &Faults,
        now: Instant,
    ) -> Loss {
        let evaluation = piece.first();
        let work = matches!(piece.purpose, Purpose::Work | Purpose::Backup);
        let alone = work && piece.len() == 1 && !self.has_ended(evaluation);
        let shared = self.is_shared(evaluation);
        let proven = self.attribution.is_proven(server);
        let together = self
            .attribution
            .server_lost(alone.then_some(evaluation), now);
        if !alone {
            return Loss::default();
        }
        let (times, hopeless) = self.attribution.lost_with(evaluation, faults, now);
        let apart = match blame {
            Blame::Silent { others } => others,
            // Work that had not begun may have been refused because of another tool.
            Blame::Lost => times > FREE_LOSSES,
            _ => true,
        };
        Loss {
            counts: proven && apart && !shared && !together,
            hopeless: hopeless.then_some(times),
        }
    }

    /// Queues work that returned no result again, or puts it aside until the fault is attributed. `counts`: whether the
    /// failure counts against the evaluation. Returns whether the failed work is retried.
    pub fn failed(
        &mut self,
        mut piece: Piece,
        failed: Failed<'_>,
        counts: bool,
        faults: &Faults,
    ) -> bool {
        let kind = match failed.blame {
            Blame::None => {
                self.put_back(&piece);
                return false;
            }
            Blame::Lost if !counts => {
                self.put_back(&piece);
                return false;
            }
            Blame::Broker => {
                self.put_back(&piece.halved());
                return false;
            }
            Blame::Evaluation | Blame::Answer => FailureKind::Reported,
            Blame::Crash => FailureKind::Crashed,
            Blame::Gone | Blame::Lost => FailureKind::Lost,
            Blame::Silent { .. } => {
                piece.late += 1;
                FailureKind::Lost
            }
        };
        let evaluation = piece.first();
        if piece.len() == 1 && self.has_ended(evaluation) {
            return false;
        }
        let piece = piece.failed(failed.server);
        if counts {
            let failure = Failure {
                server: failed.server,
                instance: failed.instance,
                reason: failed.reason.to_owned(),
                kind,
                // The server's previous evaluation succeeded.
                certain: failed.sound && self.attribution.is_proven(failed.server),
                at: failed.at,
            };
            let verdict = self.attribution.attribute(evaluation, failure, faults);
            if verdict.is_some() {
                self.put_aside(piece);
                return false;
            }
        }
        self.put_back(&piece);
        true
    }
}
