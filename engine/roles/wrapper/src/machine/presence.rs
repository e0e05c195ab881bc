//! Announcements of a server: capabilities and presence.

use swarmwright_protocol::{Capabilities, Presence, State as PresenceState, Topic};

use super::{Machine, Offer, State};
use crate::notice::{Action, Notice};

impl Machine {
    /// Returns the titles of the offered simulations.
    #[must_use]
    pub fn titles(&self) -> Vec<String> {
        self.offers
            .iter()
            .map(|offer| offer.description.title.clone())
            .collect()
    }

    /// Returns the presence message for a state.
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
        let Offer {
            description,
            describer,
            batch,
            lanes,
            sides,
            scenes,
            ..
        } = offer;
        self.identity.capabilities(
            description,
            describer.is_some(),
            sides,
            *batch,
            *lanes,
            *scenes,
        )
    }

    /// Returns whether no tool holds the server.
    #[must_use]
    pub fn is_free(&self) -> bool {
        matches!(self.state, State::Free)
    }

    /// Returns whether episodes are being stepped, or are about to be.
    #[must_use]
    pub fn is_stepping(&self) -> bool {
        matches!(
            self.state,
            State::Configured { .. } | State::Running(_) | State::Stepping(_)
        )
    }

    /// Takes the number of episodes and batches that have been stepped to their end since the last call.
    pub fn take_stepped(&mut self) -> usize {
        std::mem::take(&mut self.stepped)
    }

    /// Returns whether a message on a topic may start an episode.
    #[must_use]
    pub fn may_begin(&self, topic: &str) -> bool {
        !matches!(self.state, State::Working(_))
            && matches!(
                self.topics.parse(topic),
                Some(Topic::Control | Topic::Parameters | Topic::ToServer)
            )
    }

    /// Returns the optimization tool that has the server, if it gave its name.
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

    /// Publishes the current state of the server, unless it has already been published.
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
        // A repeated presence keeps its original time.
        let since = match self.since.take() {
            Some((published, before)) if published == current => before,
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
