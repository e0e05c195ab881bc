//! Discovery of a server with scenes.

use std::time::{Duration, Instant};

use swarmwright_mqtt::Event;
use swarmwright_protocol::{Discovery, Message, ServerMessage, Topic};

use super::SceneError;
use super::SceneError::Impossible;
use super::{GoOn, SceneEpisode, SceneServer};

/// Interval between discoveries.
const ASK: Duration = Duration::from_millis(500);
/// How long to wait for a server with scenes after one without has answered.
const BETTER: Duration = Duration::from_secs(2);

impl SceneEpisode {
    /// Returns a free server that has scenes.
    pub(super) fn find(&mut self, hash: &str, go_on: GoOn<'_>) -> Result<SceneServer, SceneError> {
        let begin = Instant::now();
        let mut limit = begin + self.options.discovery;
        let mut ask = begin;
        let mut without: Vec<u64> = Vec::new();
        while Instant::now() < limit {
            if Instant::now() >= ask {
                ask += ASK;
                let discovery = Discovery {
                    simulation: self.options.simulation.clone(),
                    simulation_hash: hash.to_owned(),
                    requirements: self.options.requirements.clone(),
                    tool: Some(self.tool.clone()),
                };
                self.send(Topic::Discovery, &discovery.encode())?;
            }
            for message in self.answers(hash, ask.min(limit), go_on)? {
                let announced = message.capabilities.swarmwright.as_ref();
                if let Some(announced) = announced.filter(|announced| announced.scenes) {
                    return Ok(SceneServer {
                        server: message.server,
                        instance: announced.instance.clone(),
                        on_own_topic: announced.control,
                    });
                }
                if !without.contains(&message.server) {
                    without.push(message.server);
                    limit = limit.min(Instant::now() + BETTER);
                }
            }
        }
        Err(Impossible(self.none_found(&without, begin.elapsed())))
    }

    fn none_found(&self, without: &[u64], waited: Duration) -> String {
        let (url, title) = (self.connection.url(), &self.options.simulation);
        if without.is_empty() {
            return format!(
                "no free server on {url} offers {title:?} ({:.1} s waited); start one, and see `swarmwright servers`",
                waited.as_secs_f64()
            );
        }
        let ids: Vec<String> = without.iter().take(8).map(u64::to_string).collect();
        format!(
            "server {} on {url} offers {title:?} without scenes (capabilities.swarmwright.scenes), so its episodes cannot be \
             shown here; give its simulation a scene, or have the server draw them: swarmwright simulate --visual",
            ids.join(", ")
        )
    }

    /// Returns the answers to a discovery that arrive within one turn.
    fn answers(
        &mut self,
        hash: &str,
        until: Instant,
        go_on: GoOn<'_>,
    ) -> Result<Vec<ServerMessage>, SceneError> {
        self.turn(until, go_on)?;
        let mut answers = Vec::new();
        for event in std::mem::take(&mut self.events) {
            match event {
                Event::Message(message) if !message.retained() => {
                    if self.topics.parse(message.topic()) == Some(Topic::Server)
                        && let Ok(Message::Server(answer)) =
                            Message::decode(Topic::Server, message.payload())
                        && answer.simulation_hash == hash
                        && answer.simulations.contains(&self.options.simulation)
                        && answer.capabilities.fulfil(&self.options.requirements)
                    {
                        answers.push(answer);
                    }
                }
                Event::Disconnected { reason, .. } => return Err(self.broken(&reason)),
                Event::Denied { message, .. } => return Err(Impossible(message)),
                Event::Message(_) | Event::Connected => {}
            }
        }
        Ok(answers)
    }
}
