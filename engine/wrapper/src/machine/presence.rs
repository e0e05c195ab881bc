//! What a server says of itself: capabilities, presence, and who else has its id.

use std::time::Instant;

use swarmwright_protocol::{Capabilities, Presence, State as PresenceState, Topic};

use super::{Machine, Offer, SETTLE, State};
use crate::notice::{Action, Notice};

impl Machine {
    /// Titles of the simulations offered.
    #[must_use]
    pub fn titles(&self) -> Vec<String> {
        self.offers
            .iter()
            .map(|offer| offer.description.title.clone())
            .collect()
    }

    /// The presence message for a state.
    #[must_use]
    pub fn presence(&self, state: PresenceState, since: String) -> Presence {
        Presence {
            server: self.identity.id,
            state,
            simulations: self.titles(),
            capabilities: self.capabilities(&self.offers[0]),
            tool: self.holder(),
            since,
        }
    }

    pub(super) fn capabilities(&self, offer: &Offer) -> Capabilities {
        self.identity
            .capabilities(&offer.description, offer.batch, offer.lanes)
    }

    /// Whether nobody has the server.
    #[must_use]
    pub fn is_free(&self) -> bool {
        matches!(self.state, State::Free)
    }

    /// The optimization tool that has the server, if it gave its name.
    #[must_use]
    pub fn holder(&self) -> Option<String> {
        match &self.state {
            State::Running(run) => run.tool.clone(),
            State::Stepping(batch) => Some(batch.tool.clone()),
            State::Working(work) => work.holder(),
            State::Held { tool, .. } => tool.clone(),
            State::Free | State::Configured { .. } => None,
        }
    }

    pub(super) fn other_presence(&mut self, presence: &Presence, now: Instant) {
        let other = presence.capabilities.swarmwright.as_ref();
        let instance = other.and_then(|other| other.instance.as_ref());
        if presence.server != self.identity.id || instance == Some(&self.identity.instance) {
            return;
        }
        if presence.state == PresenceState::Lost {
            // Another server with this id is gone, and with its last will stands in the place of what is true.
            self.published = None;
            self.changed_at = Some(now.checked_sub(SETTLE).unwrap_or(now));
        } else {
            let host = other
                .and_then(|other| other.host.clone())
                .unwrap_or_else(|| "an unknown host".to_owned());
            let pid = other
                .and_then(|other| other.pid)
                .map_or_else(String::new, |pid| format!(", process {pid}"));
            self.complain(format!(
                "another server has the id {} too ({host}{pid}); give one of them another --id",
                self.identity.id
            ));
        }
    }

    /// Publishes what the server does now, unless that is known.
    pub fn publish_presence(&mut self, since: String) {
        self.changed_at = None;
        let state = if matches!(self.state, State::Free) {
            PresenceState::Ready
        } else {
            PresenceState::Busy
        };
        let current = (state, self.holder());
        if self.published.as_ref() == Some(&current) {
            return;
        }
        // Said again, it is so since it was said first.
        let since = match self.since.take() {
            Some((said, before)) if said == current => before,
            _ => since,
        };
        self.actions.push(Action::Publish(
            Topic::Presence,
            self.presence(state, since.clone()).encode(),
        ));
        self.since = Some((current.clone(), since));
        self.actions.push(Action::Notice(match state {
            PresenceState::Busy => Notice::Busy(current.1.clone()),
            _ => Notice::Ready,
        }));
        self.published = Some(current);
    }
}
