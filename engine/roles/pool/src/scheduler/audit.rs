//! Audits: results that are compared with those of another server before they count.
//!
//! If two servers disagree, a third one decides: the server that is outvoted is not used any more, and its evaluations
//! are repeated.

use std::collections::BTreeMap;

use crate::scheduler::fleet::Fleet;
use crate::scheduler::modes::in_flight::InFlight;
use crate::scheduler::queue::results::ServerResult;

/// Results of one evaluation that no two servers agree on yet.
#[derive(Debug, Clone)]
struct Check {
    first: ServerResult,
    /// A different result from another server.
    second: Option<ServerResult>,
}

impl Check {
    fn servers(&self) -> Vec<u64> {
        let second = self.second.iter();
        std::iter::once(&self.first)
            .chain(second)
            .map(|result| result.server)
            .collect()
    }
}

/// Returns whether two results are equal, within the tolerance if there is one.
fn agree(first: &ServerResult, second: &ServerResult, tolerance: Option<f64>) -> bool {
    let is_close = |a: f64, b: f64| match tolerance {
        None => a.to_bits() == b.to_bits(),
        Some(tolerance) => (a - b).abs() <= tolerance * a.abs().max(b.abs()).max(1.0),
    };
    is_close(first.fitness, second.fitness)
        && first.metrics.len() == second.metrics.len()
        && first
            .metrics
            .iter()
            .zip(&second.metrics)
            .all(|(a, b)| is_close(*a, *b))
}

/// Draws a share of all evaluations without a pattern that could match the order of the evaluations (`SplitMix64`).
fn is_drawn(share: f64, seed: u64, evaluation: usize) -> bool {
    let mut bits = seed.wrapping_add((evaluation as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15));
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    bits ^= bits >> 31;
    #[expect(clippy::cast_precision_loss, reason = "a share needs no more")]
    let part = (bits >> 11) as f64 / (1u64 << 53) as f64;
    part < share
}

/// Outcome of comparing a further result of an audited evaluation.
pub(crate) enum Compared {
    /// The evaluation is not under audit any more.
    Late,
    /// The server has already returned a result.
    Double,
    /// Two servers found this result.
    Agreed(ServerResult),
    /// Two servers disagree.
    Differ(ServerResult, ServerResult),
    /// Two servers agree, the third disagrees.
    Wrong {
        right: [ServerResult; 2],
        wrong: ServerResult,
    },
    /// All three results differ.
    AllDiffer([ServerResult; 3]),
}

/// Results that wait for a second server's result, by evaluation.
#[derive(Debug, Default)]
pub(crate) struct Audits(BTreeMap<usize, Check>);

impl Audits {
    /// Returns whether to audit an evaluation done by `server`, provided that another server can. `seed` differs for
    /// each piece of work.
    pub fn draws(
        &self,
        share: f64,
        seed: u64,
        evaluation: usize,
        server: u64,
        fleet: &Fleet,
    ) -> bool {
        share > 0.0
            && is_drawn(share, seed, evaluation)
            && fleet.is_comparable(server)
            && fleet.auditors_but(&[server]).is_some()
    }

    /// Returns whether a result of an evaluation waits for another server's.
    pub fn has(&self, evaluation: usize) -> bool {
        self.0.contains_key(&evaluation)
    }

    /// Returns whether no result waits for another server's.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Adds a result that waits for another server's, or two differing results that wait for a third server's.
    pub fn wait(&mut self, evaluation: usize, first: ServerResult, second: Option<ServerResult>) {
        self.0.insert(evaluation, Check { first, second });
    }

    /// Compares another server's result with the waiting ones.
    pub fn compare(&mut self, evaluation: usize, result: ServerResult, fleet: &Fleet) -> Compared {
        let Some(check) = self.0.remove(&evaluation) else {
            return Compared::Late;
        };
        if check.servers().contains(&result.server) {
            self.0.insert(evaluation, check);
            return Compared::Double;
        }
        let tolerance = |other: &ServerResult| fleet.tolerance(other.server, result.server);
        let agrees = |other: &ServerResult| agree(other, &result, tolerance(other));
        let Check { first, second } = check;
        match second {
            None if agrees(&first) => Compared::Agreed(first),
            None => Compared::Differ(first, result),
            Some(second) => match (agrees(&first), agrees(&second)) {
                (true, true) => Compared::Agreed(first),
                (true, false) => Compared::Wrong {
                    right: [first, result],
                    wrong: second,
                },
                (false, true) => Compared::Wrong {
                    right: [second, result],
                    wrong: first,
                },
                (false, false) => Compared::AllDiffer([first, second, result]),
            },
        }
    }

    /// Ends the audit of an evaluation and returns its waiting results.
    pub fn end(&mut self, evaluation: usize) -> Option<(ServerResult, Option<ServerResult>)> {
        let check = self.0.remove(&evaluation)?;
        Some((check.first, check.second))
    }

    /// Ends all audits and returns their results, by evaluation.
    pub fn take_all(&mut self) -> impl Iterator<Item = (usize, Vec<ServerResult>)> + use<> {
        let checks = std::mem::take(&mut self.0).into_iter();
        checks.map(|(evaluation, check)| {
            let results = std::iter::once(check.first).chain(check.second);
            (evaluation, results.collect())
        })
    }

    /// Returns the evaluations that no further server can audit or is auditing; once nothing else is in flight, also
    /// those for which no remaining server is likely to succeed. If an evaluation has a single result, the id of its
    /// server is given.
    pub fn unchecked(&self, fleet: &Fleet, in_flight: &InFlight) -> Vec<(usize, Option<u64>)> {
        let is_last = in_flight.has_probes_alone();
        let alone = |check: &Check| {
            let servers = check.servers();
            fleet.auditors_but(&servers).is_none() || (is_last && !fleet.has_auditor_but(&servers))
        };
        self.0
            .iter()
            .filter(|(evaluation, check)| alone(check) && !in_flight.has(**evaluation))
            .map(|(evaluation, check)| {
                let first = check.second.is_none().then_some(check.first.server);
                (*evaluation, first)
            })
            .collect()
    }

    pub fn clear(&mut self) {
        self.0.clear();
    }
}
