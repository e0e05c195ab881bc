//! Stepwise evaluation: the controllers stay with the tool, and each agent's step is a message.

use std::time::{Duration, Instant};

use swarmwright_protocol::{
    Actuator, Control, EXTENSION_VERSION, Failed, MAX_BLOCK, MAX_PAYLOAD, MAX_SENSOR, MOST_REASON,
    ToTool, Topic, shortened,
};
use swarmwright_worlds::Failure;

use super::{Action, BEGUN, Machine, Offer, PATIENCE, State, asker, name, reply_fits};
use crate::run::{NoStart, Outcome, Run};

/// Largest number of characters of a foreign title in messages.
const MOST_TITLE: usize = 200;

impl Machine {
    pub(super) fn control(&mut self, control: Control, now: Instant) {
        if !control.run {
            return self.end(&control, now);
        }
        match &self.state {
            State::Running(run) if run.hash == control.simulation_hash => {
                return self.complain(
                    "ignoring a control message that starts a run that is under way".to_owned(),
                );
            }
            State::Running(_) | State::Stepping(_) | State::Working(_) => {
                let holder = self.holder();
                let holder = holder.as_deref().unwrap_or("another optimization tool");
                return self.turn_away(&control, &format!("taken by {holder}"), now);
            }
            State::Held { tool, .. } if control.tool != *tool => {
                let reason = format!("held by {}", name(tool.as_deref()));
                return self.turn_away(&control, &reason, now);
            }
            _ => {}
        }
        if let Some(title) = control.simulation.as_ref()
            && self.offered(title).is_err()
        {
            return self.refuse_title(&control);
        }
        let hash = control.simulation_hash.clone();
        if control.reply.is_some() && self.begun.contains(&hash) {
            // The message is a duplicate; a tool that does not know yet that the run has ended would continue it.
            return self
                .complain("ignoring a control message that starts a run a second time".to_owned());
        }
        let Some((_, parameters)) = self.parameters.iter().find(|(other, _)| *other == hash) else {
            return self.keep_early(control, now);
        };
        let parameters = parameters.clone();
        let Some(index) = self.wanted(&control) else {
            return self.complain(format!(
                "refusing to start a run for {}: it names no simulation",
                asker(&control)
            ));
        };
        let Offer {
            description,
            simulation: Some(simulation),
            ..
        } = &mut self.offers[index]
        else {
            return;
        };
        let (tool, reply) = (control.tool.clone(), control.reply.clone());
        if reply.is_some() {
            if self.begun.len() >= BEGUN {
                self.begun.pop_front();
            }
            self.begun.push_back(hash.clone());
        }
        let title = description.title.clone();
        let template = Run::template(hash.clone(), title, index, control, now);
        match Run::start(&mut **simulation, &parameters, template) {
            Ok(run) => {
                self.enter(State::Running(Box::new(run)), now);
                self.show(now);
                if !self.paused() {
                    self.sense(now);
                }
            }
            Err(no_start) => {
                let (failure, invalid) = match no_start {
                    NoStart::Refused(error) => {
                        let reason = shortened(error.to_string(), MOST_REASON);
                        (Failure::from(reason), true)
                    }
                    NoStart::Failed(failure) => (failure, false),
                };
                self.warn(format!("cannot start the run: {failure}"));
                self.report(reply, hash, failure, invalid);
                let until = now + PATIENCE;
                let held = |tool| State::Held {
                    tool: Some(tool),
                    until,
                };
                self.enter(tool.map_or(State::Free, held), now);
            }
        }
    }

    /// Turns a tool away while another one has the server. The late tool waits for its first step and would not notice
    /// that the server was taken only for a moment, so the presence is published again even if it has not changed.
    fn turn_away(&mut self, control: &Control, reason: &str, now: Instant) {
        self.complain(format!(
            "refusing to start a run for {}: {reason}",
            asker(control)
        ));
        self.published = None;
        self.changed_at.get_or_insert(now);
    }

    /// Refuses an episode of a simulation that is not offered; the tool mistakes this server for another one.
    fn refuse_title(&mut self, control: &Control) {
        let title = shortened(control.simulation.clone().unwrap_or_default(), MOST_TITLE);
        let reason = format!(
            "simulation: {title:?} is not offered here, only {}",
            self.titles().join(", ")
        );
        self.complain(format!(
            "refusing to start a run for {}: {reason}",
            asker(control)
        ));
        let hash = control.simulation_hash.clone();
        self.report(control.reply.clone(), hash, reason.into(), true);
    }

    /// Handles control for another instance with this id. If that instance has ended, its tool learns of this one.
    pub(super) fn turn_away_from_another(&mut self, control: &Control, now: Instant) {
        let offered = control
            .simulation
            .as_ref()
            .is_none_or(|title| self.offered(title).is_ok());
        if control.run && self.is_free() && offered {
            self.turn_away(control, "it is meant for another server with this id", now);
        }
    }

    /// Tells the tool that an episode has ended without fitness, if it gave a reply topic.
    pub(super) fn report(
        &mut self,
        reply: Option<String>,
        simulation_hash: String,
        failure: Failure,
        invalid: bool,
    ) {
        let Some(topic) = reply.filter(|reply| self.can_reply(reply)) else {
            return;
        };
        let message = ToTool::Failed(Failed {
            version: EXTENSION_VERSION,
            server: self.identity.id,
            simulation_hash,
            reason: failure.reason,
            stack: failure.stack,
            invalid,
        });
        self.actions.push(Action::Reply {
            topic,
            request: None,
            payload: message.encode(),
        });
    }

    /// Returns the simulation that a control message means: the one that it names, the one that its discovery named, or
    /// the only one. The name in the message has already been checked.
    fn wanted(&self, control: &Control) -> Option<usize> {
        if self.offers.len() == 1 {
            return Some(0);
        }
        let discovered = self
            .discovered
            .iter()
            .find(|(hash, _)| *hash == control.simulation_hash)
            .map(|(_, title)| title);
        let title = control.simulation.as_ref().or(discovered)?;
        self.offers
            .iter()
            .position(|offer| offer.description.title == *title)
    }

    /// Returns whether an actuator message belongs to another server's run, without parsing it as JSON. All servers
    /// receive all actuator messages, so most of them are foreign if there are many servers.
    pub(super) fn is_foreign(&self, payload: &[u8]) -> bool {
        let State::Running(run) = &self.state else {
            return false;
        };
        let object = payload.first() == Some(&b'{') && payload.last() == Some(&b'}');
        // A hash may be written with escapes.
        object
            && payload.len() <= MAX_PAYLOAD
            && !run.is_named_in(payload)
            && memchr::memchr(b'\\', payload).is_none()
    }

    pub(super) fn actuate(&mut self, actuator: &Actuator, now: Instant) {
        let State::Running(run) = &mut self.state else {
            return;
        };
        if run.hash != actuator.simulation_hash {
            return;
        }
        let Some(simulation) = self.offers[run.simulation].simulation.as_deref_mut() else {
            return;
        };
        match run.actuate(simulation, actuator) {
            Ok(outcome) => self.proceed(outcome, now),
            Err(reason) => self.complain(format!("refusing an actuator message: {reason}")),
        }
    }

    /// Sends the sensors of the step that begins, or the fitness.
    pub(super) fn sense(&mut self, now: Instant) {
        let State::Running(run) = &mut self.state else {
            return;
        };
        let Some(simulation) = self.offers[run.simulation].simulation.as_deref_mut() else {
            return;
        };
        let actions = &mut self.actions;
        let outcome = run.sense(simulation, now, |payload| {
            actions.push(Action::Publish(Topic::Sensor, payload));
        });
        if outcome != Outcome::Stepped {
            self.proceed(outcome, now);
        }
    }

    /// Handles a message of `bytes` bytes that the broker does not accept. The run cannot continue, and a retry would
    /// fail, too.
    pub fn unsent(&mut self, topic: Topic, bytes: usize, most: usize, now: Instant) {
        let reason = format!(
            "a {} message of {bytes} bytes is larger than the {most} that the broker accepts",
            if topic == Topic::ToTool {
                "scene"
            } else {
                topic.name()
            }
        );
        if !matches!(self.state, State::Running(_)) {
            return self.complain(reason);
        }
        self.fail(reason.into(), true, now);
    }

    fn proceed(&mut self, outcome: Outcome, now: Instant) {
        match outcome {
            Outcome::Wait => {}
            Outcome::WentOn => self.show(now),
            Outcome::Stepped => {
                self.show(now);
                if !self.paused() {
                    self.sense(now);
                }
            }
            Outcome::Finished(fitness, unmeasured) => {
                if let Some(failure) = unmeasured {
                    self.complain(format!("the metrics are left out: {}", failure.reason));
                }
                self.actions
                    .push(Action::Publish(Topic::Fitness, fitness.encode()));
                self.leave(now);
            }
            Outcome::Failed(failure) => self.fail(failure, false, now),
            Outcome::TooLarge { agent, bytes } => {
                let reason = format!(
                    "the sensor message of agent {agent} has {bytes} bytes, more than the {MAX_SENSOR} allowed"
                );
                self.fail(reason.into(), true, now);
            }
        }
    }

    /// Ends the run without fitness. `invalid`: a retry would fail the same way.
    fn fail(&mut self, failure: Failure, invalid: bool, now: Instant) {
        self.warn(failure.reason.clone());
        if let State::Running(run) = &self.state {
            let (reply, hash) = (run.reply.clone(), run.hash.clone());
            self.report(reply, hash, failure, invalid);
        }
        self.leave(now);
    }

    /// Sends the scene to the tool, if requested. In visual mode, shows a frame and slows the run down to real time.
    fn show(&mut self, now: Instant) {
        let State::Running(run) = &mut self.state else {
            return;
        };
        let Offer {
            simulation: Some(simulation),
            scenes,
            ..
        } = &self.offers[run.simulation]
        else {
            return;
        };
        // If agents act in turn, show one frame per step instead of one per agent.
        if simulation.mid_step() {
            return;
        }
        if *scenes
            && let Some(topic) = run.reply.clone()
            && reply_fits(&topic)
        {
            match run.scene(&**simulation, self.identity.id) {
                Ok(Some(payload)) if payload.len() > MAX_BLOCK => {
                    let bytes = payload.len();
                    let reason = format!(
                        "a scene message of {bytes} bytes is larger than the {MAX_BLOCK} allowed"
                    );
                    return self.fail(reason.into(), true, now);
                }
                Ok(Some(payload)) => self.actions.push(Action::Reply {
                    topic,
                    request: None,
                    payload,
                }),
                Ok(None) => {}
                Err(failure) => return self.fail(failure, false, now),
            }
        }
        if run.visual
            && let Some(scene) = simulation.scene()
        {
            run.resume_at = Some(now + Duration::from_millis(simulation.step_size()));
            self.actions.push(Action::Frame(scene));
        }
    }

    fn paused(&self) -> bool {
        matches!(&self.state, State::Running(run) if run.resume_at.is_some())
    }
}
