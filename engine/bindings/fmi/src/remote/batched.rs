//! An episode as a batch of one: each message has all agents that act.

use std::time::{Duration, Instant};

use swarmwright_protocol::{
    BatchActuators, BatchSensors, BatchStart, EXTENSION_VERSION, F32s, RefusalKind, ToServer, U64s,
};
use swarmwright_worlds::Parameters;

use super::link::News;
use super::{Episode, Refused, Remote};

/// The batch.
pub struct Batched {
    request: u64,
    /// The step of the last sensors.
    step: u64,
    /// Agents that act, in the order in which the server named them.
    agents: Vec<usize>,
}

impl Remote {
    pub(super) fn start_batch(
        &mut self,
        parameters: &Parameters,
        patience: Duration,
    ) -> Result<(), Refused> {
        let request = fastrand::u64(..1 << 52);
        self.episode = Episode::Batched(Batched {
            request,
            step: 0,
            agents: Vec::new(),
        });
        let seed = parameters.get("seed").and_then(serde_json::Value::as_u64);
        let title = self.options().simulation;
        let start = ToServer::Start(BatchStart {
            version: EXTENSION_VERSION,
            request,
            tool: self.tool.clone(),
            reply: self.link().map_err(Refused::For)?.reply.clone(),
            simulation: title,
            parameters: parameters.clone(),
            seeds: U64s(vec![seed.unwrap_or_default()]),
            metrics: self.model.metrics.clone(),
            instance: self.instance(),
        });
        self.ask(&start).map_err(Refused::For)?;
        let id = self.server_id();
        match self.batch_news(request, 0, patience) {
            Ok(None) => {
                self.release();
                Err(Refused::Taken(format!(
                    "server {id} did not begin the episode"
                )))
            }
            // The server has left, but there may be another one.
            Err(reason) => {
                self.release();
                Err(Refused::Taken(reason))
            }
            Ok(Some(batch)) => match &batch.error {
                Some(error) if error.kind == RefusalKind::Taken => {
                    self.episode = Episode::None;
                    Err(Refused::Taken(format!("server {id}: {}", error.reason)))
                }
                _ => self.take_batch(*batch).map_err(Refused::For),
            },
        }
    }

    fn ask(&mut self, message: &ToServer) -> Result<(), String> {
        let id = self.server_id();
        let link = self.link()?;
        link.publish(link.topics.to_server(id), message.encode());
        Ok(())
    }

    /// The server's message for a step; none if it does not come.
    fn batch_news(
        &mut self,
        request: u64,
        step: u64,
        patience: Duration,
    ) -> Result<Option<Box<BatchSensors>>, String> {
        let until = Instant::now() + patience;
        while let Some(news) = self.news(until)? {
            if let News::Batch(batch) = news
                && batch.request == request
                && batch.step >= step
            {
                return Ok(Some(batch));
            }
        }
        Ok(None)
    }

    fn take_batch(&mut self, batch: BatchSensors) -> Result<(), String> {
        let id = self.server_id();
        if let Some(error) = &batch.error {
            return Err(format!("server {id} refuses: {}", error.reason));
        }
        if let Some(failure) = batch.failed.first() {
            let reason = &failure.reason;
            return Err(format!("the episode failed on server {id}: {reason}"));
        }
        if let Some(fitness) = batch.fitness.0.first() {
            let metrics = &batch.metrics;
            return self.ended(*fitness, |name| {
                metrics.get(name).and_then(|row| row.0.first()).copied()
            });
        }
        let (rows, each) = (batch.agents.0.len(), self.model.sensors);
        if rows == 0 {
            return Err(format!(
                "server {id}: no agent acts, but the episode has not ended"
            ));
        }
        if batch.sensors.0.len() != rows * each {
            return Err(format!(
                "server {id}: {} sensors for {rows} agents, but the FMU has variables for {each} each; export it again for this \
                 simulation (swarmwright export-fmu --proxy)",
                batch.sensors.0.len()
            ));
        }
        self.view.acts.fill(false);
        let agents: Vec<usize> = batch.agents.0.iter().map(|agent| *agent as usize).collect();
        for (agent, values) in agents.iter().zip(batch.sensors.0.chunks_exact(each)) {
            self.sensed(*agent, values)?;
        }
        if let Episode::Batched(state) = &mut self.episode {
            (state.step, state.agents) = (batch.step, agents);
        }
        Ok(())
    }

    pub(super) fn step_batch(&mut self, actuators: &[f32]) -> Result<(), String> {
        let Episode::Batched(Batched {
            request,
            step,
            agents,
        }) = &self.episode
        else {
            return Ok(());
        };
        let (request, step, each) = (*request, *step, self.model.actuators);
        let rows = agents
            .iter()
            .flat_map(|agent| &actuators[agent * each..(agent + 1) * each]);
        let message = ToServer::Actuators(BatchActuators {
            version: EXTENSION_VERSION,
            request,
            step,
            actuators: F32s(rows.copied().collect()),
        });
        self.ask(&message)?;
        let patience = self.options().step;
        match self.batch_news(request, step + 1, patience)? {
            Some(batch) => self.take_batch(*batch),
            None => Err(self.silent("sent nothing")),
        }
    }

    /// Ends a batch: there are no actuators for its step.
    pub(super) fn end_batch(&mut self, batch: &Batched) -> Result<(), String> {
        self.ask(&ToServer::Actuators(BatchActuators {
            version: EXTENSION_VERSION,
            request: batch.request,
            step: batch.step,
            actuators: F32s(Vec::new()),
        }))
    }
}
