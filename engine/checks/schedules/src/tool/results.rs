//! Results of a tool, compared with those of an undisturbed evaluation.

use swarmwright_pool::Attempt;

use super::{Stage, Tool};

impl Tool {
    /// The run ends without results, and can be resumed.
    pub(super) fn end(&mut self, reason: &str) -> Result<(), String> {
        if !self.may_end {
            return Err(format!(
                "the run ended although nothing explains it: {reason}"
            ));
        }
        if let Some(machine) = &mut self.machine {
            machine.cancel();
        }
        self.ended += 1;
        self.stage = Stage::Finished;
        Ok(())
    }

    /// All of a work has ended.
    pub(super) fn conclude(&mut self) -> Result<(), String> {
        if let Some(missing) = self.results.iter().position(Option::is_none) {
            return Err(format!(
                "work {} has ended without candidate {missing}",
                self.work
            ));
        }
        self.results.clear();
        self.work += 1;
        self.stage = if self.work < self.plan.works.len() {
            Stage::Thinking
        } else {
            Stage::Finished
        };
        Ok(())
    }

    /// The fitness of a candidate, by the machine's number, in all episodes.
    pub(super) fn score(&mut self, row: usize, fitness: Vec<f64>) -> Result<(), String> {
        let Some(&candidate) = self.sent.get(row) else {
            return Err(format!(
                "candidate {row} came, but only {} were handed over",
                self.sent.len()
            ));
        };
        if self.results[candidate].is_some() {
            return Err(format!(
                "candidate {candidate} of work {} was scored twice",
                self.work
            ));
        }
        let episodes = self.plan.works[self.work].episodes;
        for (episode, value) in fitness.iter().enumerate() {
            let evaluation = format!(
                "candidate {candidate}, episode {episode} of work {}",
                self.work
            );
            match self.expected[candidate * episodes + episode] {
                None if value.is_nan() => {}
                None => return Err(format!("{evaluation} cannot be computed, but {value} came")),
                Some(_) if value.is_nan() => self.explain(row, episode, &evaluation),
                Some(expected) if expected.to_bits() == value.to_bits() => self.succeeded = true,
                Some(expected) => {
                    return Err(format!("{evaluation}: {value} came, expected {expected}"));
                }
            }
        }
        self.scored += 1;
        self.results[candidate] = Some(fitness);
        Ok(())
    }

    /// An evaluation was reported failed that could have been computed.
    fn explain(&mut self, row: usize, episode: usize, evaluation: &str) {
        let covers = |attempt: &&Attempt| {
            (attempt.candidate..attempt.candidate + attempt.candidates).contains(&row)
                && (attempt.episode..attempt.episode + attempt.episodes).contains(&episode)
        };
        let failures = || {
            self.journal
                .iter()
                .filter(covers)
                .filter(|attempt| attempt.error.is_some())
        };
        let errors: Vec<String> = failures()
            .map(|attempt| {
                format!(
                    "server {}: {}",
                    attempt.server,
                    attempt.error.clone().unwrap_or_default()
                )
            })
            .collect();
        // Candidates that are handed over one by one cannot wait until any succeeds: up to then they are believed to fail.
        let alone = self.may_break && self.plan.works[self.work].window.is_some();
        if self.may_fail || (alone && !self.succeeded) {
            self.failed += 1;
        } else {
            let text = format!("{evaluation} was reported failed, but is sound: {errors:?}");
            self.wronged.push(text);
        }
    }
}
