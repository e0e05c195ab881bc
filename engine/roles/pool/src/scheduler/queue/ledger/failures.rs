//! What becomes of work that brought no result, and what counts against it.

use std::time::Instant;

use super::Ledger;
use crate::scheduler::queue::blame::{Blame, Failure, FailureKind};
use crate::scheduler::queue::piece::{Piece, Purpose};
use crate::sections::Faults;

/// How often a server may be lost with an episode that it had not begun before that counts.
const FREE_LOSSES: u32 = 3;

/// A piece that a server did not evaluate.
pub(crate) struct Failed<'a> {
    pub server: u64,
    /// Which start of it, where it says so.
    pub instance: Option<String>,
    pub reason: &'a str,
    pub blame: Blame,
    /// Whether the server has failed nothing of late, and repeats itself to the bit.
    pub sound: bool,
    pub at: Instant,
}

/// What a loss of a server says of the evaluation that it was at.
#[derive(Debug, Default, PartialEq, Eq)]
pub(crate) struct Loss {
    /// Whether it counts against the evaluation.
    pub counts: bool,
    /// How often servers were lost with it, where it can never be told whether it is the cause.
    pub hopeless: Option<u32>,
}

impl Ledger {
    /// A server was lost, or silent for too long. Whether that counts against what it was at: it was at one evaluation
    /// alone, had succeeded with others before, and the trouble is not all servers'.
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
            // Work that has not begun may have been refused for another tool.
            Blame::Lost => times > FREE_LOSSES,
            _ => true,
        };
        Loss {
            counts: proven && apart && !shared && !together,
            hopeless: hopeless.then_some(times),
        }
    }

    /// Work that brought no result waits again, or until it is known whose fault that is. `counts`: whether it counts
    /// against the evaluation. Returns whether another attempt is made of what failed.
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
                // Its previous work succeeded.
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
