//! Messages of a server during an episode.

use std::collections::BTreeMap;
use std::time::Instant;

use swarmwright_mqtt::Event;
use swarmwright_protocol::{DecodeError, Message, SensorReading, ToTool, Topic};

use super::SceneError;
use super::SceneError::Impossible;
use super::{GoOn, News, SceneEpisode};

/// Number of agents above which the server is at fault.
const MOST_AGENTS: usize = 1_000_000;
/// Number of bytes of an unreadable message that are searched for the hash.
const AROUND: usize = 4096;

impl SceneEpisode {
    /// Reads the messages that arrive until `until`, but at most for 0.1 s.
    pub(super) fn receive(&mut self, until: Instant, go_on: GoOn<'_>) -> Result<(), SceneError> {
        self.turn(until, go_on)?;
        for event in std::mem::take(&mut self.events) {
            match event {
                Event::Message(message) if !message.retained() => {
                    if let Some(topic) = self.topics.parse(message.topic()) {
                        self.read(topic, message.payload())?;
                    }
                }
                Event::Disconnected { reason, .. } => return Err(self.broken(&reason)),
                Event::Denied { message, .. } => return Err(Impossible(message)),
                Event::Message(_) | Event::Connected => {}
            }
        }
        Ok(())
    }

    /// Reads a message; messages that are unreadable or belong to another episode are ignored.
    fn read(&mut self, topic: Topic, payload: &[u8]) -> Result<(), SceneError> {
        match topic {
            Topic::Sensor => match SensorReading::decode(payload) {
                Ok(sensor) if sensor.simulation_hash == self.hash => {
                    let agent = usize::try_from(sensor.agent).unwrap_or(usize::MAX);
                    if agent >= MOST_AGENTS {
                        return Err(Impossible(format!(
                            "server {}: agent {agent} is above {}, the largest index of an agent",
                            self.server,
                            MOST_AGENTS - 1
                        )));
                    }
                    let values = sensor.sensor;
                    self.heard = Instant::now();
                    self.waiting.push_back(News::Sensors { agent, values });
                }
                Err(error) if self.is_named_in(payload) => return Err(self.unread(topic, &error)),
                _ => {}
            },
            Topic::Fitness => match Message::decode(topic, payload) {
                Ok(Message::Fitness(fitness)) if fitness.simulation_hash == self.hash => {
                    self.heard = Instant::now();
                    self.fitness.get_or_insert((fitness, self.heard));
                }
                Err(error) if self.is_named_in(payload) => return Err(self.unread(topic, &error)),
                _ => {}
            },
            Topic::ToTool => match ToTool::decode(payload) {
                Ok(ToTool::Scene(scene)) if scene.simulation_hash == self.hash => {
                    self.heard = Instant::now();
                    self.waiting.push_back(News::Scene(scene));
                }
                Ok(ToTool::Failed(failed)) if failed.simulation_hash == self.hash => {
                    let reason = format!(
                        "the episode failed on server {}: {}",
                        self.server, failed.reason
                    );
                    self.ended = Some((f64::NAN, BTreeMap::new()));
                    return Err(Impossible(reason));
                }
                // Only this tool's messages arrive on this topic.
                Err(error) => return Err(self.unread(topic, &error)),
                Ok(_) => {}
            },
            _ => {}
        }
        Ok(())
    }

    fn is_named_in(&self, payload: &[u8]) -> bool {
        let end = payload.len().min(AROUND);
        String::from_utf8_lossy(&payload[..end]).contains(&self.hash)
    }

    fn unread(&self, topic: Topic, error: &DecodeError) -> SceneError {
        let name = if topic == Topic::ToTool {
            "scene"
        } else {
            topic.name()
        };
        Impossible(format!("server {}: {name} message: {error}", self.server))
    }
}
