//! An episode by the messages of D6.1: one for each agent in a step, and none that says how many there are.

use std::time::{Duration, Instant};

use swarmwright_protocol::{Control, ParametersMessage, ReadingWriter, Topic};
use swarmwright_worlds::Parameters;

use super::link::News;
use super::{Episode, Refused, Remote};

/// The episode.
pub struct Stepwise {
    pub hash: String,
    writer: ReadingWriter,
}

/// What comes after the actuators of a step.
enum Came {
    Sensors,
    End,
    Nothing,
}

impl Remote {
    pub(super) fn start_stepwise(
        &mut self,
        parameters: &Parameters,
        patience: Duration,
    ) -> Result<(), Refused> {
        let [_, hash] = self.hashes(parameters);
        let (id, instance, title) = (self.server_id(), self.instance(), self.options().simulation);
        self.episode = Episode::Stepwise(Stepwise {
            writer: ReadingWriter::actuator(&title, &hash),
            hash: hash.clone(),
        });
        self.link().map_err(Refused::For)?.listen("", &hash);
        let message = ParametersMessage {
            server: id,
            simulation_hash: hash.clone(),
            parameters: parameters.clone(),
        };
        self.send(Topic::Parameters, message.encode())
            .map_err(Refused::For)?;
        self.control(id, hash, true, instance)
            .map_err(Refused::For)?;
        let all = vec![true; self.model.agents];
        match self.gather(&all, patience) {
            Ok(Came::Nothing) => {
                self.release();
                Err(Refused::Taken(format!(
                    "server {id} did not begin the episode"
                )))
            }
            Ok(_) => Ok(()),
            Err(reason) => Err(Refused::For(reason)),
        }
    }

    fn send(&mut self, topic: Topic, payload: Vec<u8>) -> Result<(), String> {
        let link = self.link()?;
        link.publish(link.topics.name(topic), payload);
        Ok(())
    }

    pub(super) fn control(
        &mut self,
        server: u64,
        hash: String,
        run: bool,
        instance: Option<String>,
    ) -> Result<(), String> {
        let control = Control {
            server,
            simulation: Some(self.options().simulation),
            simulation_hash: hash,
            run,
            visual: false,
            tool: Some(self.tool.clone()),
            reply: if run {
                Some(self.link()?.reply.clone())
            } else {
                None
            },
            instance,
            scenes: None,
        };
        let announced = self.announcement();
        let alone = announced.is_some_and(|announced| announced.control);
        let link = self.link()?;
        let topic = if alone {
            link.topics.to_server(server)
        } else {
            link.topics.name(Topic::Control)
        };
        link.publish(topic, control.encode());
        Ok(())
    }

    /// Waits for the sensors of the next step. All agents of `expected` are enough; where some do not come, the others
    /// count after a time of silence: agents may drop out, and those that act in turn come alone.
    fn gather(&mut self, expected: &[bool], patience: Duration) -> Result<Came, String> {
        let (limit, silence) = (Instant::now() + patience, self.options().gather);
        let mut until = limit;
        self.view.acts.fill(false);
        loop {
            let complete = || {
                let mut pairs = expected.iter().zip(&self.view.acts);
                pairs.all(|(is_expected, came)| *came || !is_expected)
            };
            let any_acts = self.view.acts.contains(&true);
            if any_acts && complete() {
                return Ok(Came::Sensors);
            }
            match self.news(until)? {
                Some(News::Sensors { agent, values }) => {
                    self.sensed(agent, &values)?;
                    until = limit.min(Instant::now() + silence);
                }
                Some(News::Fitness(fitness)) => {
                    self.ended(fitness.fitness, |name| fitness.metrics.get(name).copied())?;
                    return Ok(Came::End);
                }
                Some(News::Failed(failed)) => {
                    let reason = failed.reason;
                    return Err(format!(
                        "the episode failed on server {}: {reason}",
                        failed.server
                    ));
                }
                Some(_) => {}
                None if any_acts => return Ok(Came::Sensors),
                None => return Ok(Came::Nothing),
            }
        }
    }

    pub(super) fn step_stepwise(&mut self, actuators: &[f32]) -> Result<(), String> {
        let Episode::Stepwise(episode) = &self.episode else {
            return Ok(());
        };
        let (each, acted) = (self.model.actuators, self.view.acts.clone());
        let messages: Vec<Vec<u8>> = (0..self.model.agents)
            .filter(|agent| acted[*agent])
            .map(|agent| {
                let row = &actuators[agent * each..(agent + 1) * each];
                episode.writer.encode(agent as u64, row)
            })
            .collect();
        for message in messages {
            self.send(Topic::Actuator, message)?;
        }
        let patience = self.options().step;
        match self.gather(&acted, patience)? {
            Came::Nothing => Err(self.silent("sent nothing")),
            Came::Sensors | Came::End => Ok(()),
        }
    }
}
