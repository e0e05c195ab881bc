//! Looking for a free server.

use std::time::{Duration, Instant};

use serde_json::Map;
use swarmwright_protocol::{Discovery, Requirements, ServerMessage, Topic};

use super::Remote;
use super::link::News;

/// How often discovery is repeated.
const ASK: Duration = Duration::from_millis(500);
/// Servers that a message names.
const MOST_NAMED: usize = 8;

impl Remote {
    /// A free server. `since`: when the search began; `left`: for how long it goes on; `refusal`: why the last one was not
    /// used.
    pub(super) fn find(
        &mut self,
        since: Instant,
        left: Duration,
        refusal: Option<String>,
    ) -> Result<ServerMessage, String> {
        let options = self.options();
        let [hash, _] = self.hashes(&Map::new());
        self.link()?.listen(&hash, "");
        let limit = Instant::now() + left;
        let mut ask = Instant::now();
        loop {
            if Instant::now() >= ask {
                ask = Instant::now() + ASK;
                let discovery = Discovery {
                    simulation: options.simulation.clone(),
                    simulation_hash: hash.clone(),
                    requirements: Requirements {
                        dimensions: self.model.dimensions.unwrap_or(2.0),
                        max_agents: None,
                    },
                    tool: Some(self.tool.clone()),
                };
                let topic = self.link()?.topics.name(Topic::Discovery);
                self.link()?.publish(topic, discovery.encode());
            }
            match self.link()?.next(ask.min(limit)) {
                Some(News::Answer(answer)) => {
                    let is_wanted = options.server.is_none_or(|id| id == answer.server);
                    if is_wanted && answer.simulations.contains(&options.simulation) {
                        return Ok(*answer);
                    }
                }
                Some(News::Disconnected(reason)) => {
                    let url = &self.link()?.url;
                    return Err(format!(
                        "the connection to the broker at {url} broke: {reason}"
                    ));
                }
                Some(News::Unsent(reason)) => return Err(reason),
                _ => {}
            }
            if Instant::now() >= limit {
                return Err(self.none_found(since.elapsed(), refusal.as_deref()));
            }
        }
    }

    fn none_found(&mut self, waited: Duration, refusal: Option<&str>) -> String {
        let options = self.options();
        let title = &options.simulation;
        let (url, presences) = match &self.link {
            Some(link) => (link.url.clone(), link.presences()),
            None => (options.broker.clone(), Vec::new()),
        };
        let subject = match options.server {
            Some(id) => format!("server {id} on {url} is not free for"),
            None => format!("no free server on {url} offers"),
        };
        let dimensions = self.model.dimensions.unwrap_or(2.0);
        let mut reasons: Vec<String> = presences
            .iter()
            .take(MOST_NAMED)
            .map(|presence| {
                let id = presence.server;
                if !presence.simulations.contains(title) {
                    let offered = presence.simulations.join(", ");
                    format!("server {id} offers {offered}")
                } else if (presence.capabilities.dimensions - dimensions).abs() > 0.0 {
                    let has = presence.capabilities.dimensions;
                    format!("server {id} has {has} dimensions, the FMU {dimensions}")
                } else {
                    match &presence.tool {
                        Some(tool) => format!("server {id} is used by {tool}"),
                        None => format!("server {id} is busy or does not answer"),
                    }
                }
            })
            .collect();
        if let Some(refusal) = refusal {
            reasons.push(refusal.to_owned());
        }
        let reasons = if reasons.is_empty() {
            "no Swarmwright server is connected".to_owned()
        } else {
            reasons.join("; ")
        };
        format!(
            "{subject} {title:?} ({:.1} s waited, connection.discoveryTimeout): {reasons}; start one (swarmwright serve) or list \
             them (swarmwright servers)",
            waited.as_secs_f64()
        )
    }
}
