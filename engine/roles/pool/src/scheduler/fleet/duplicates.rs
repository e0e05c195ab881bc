//! Results of servers whose id may be shared by another server.

use std::collections::{BTreeMap, BTreeSet};

/// For each id, the number of results returned before and since the last proof that only one server has the id.
#[derive(Debug, Default)]
pub(crate) struct Unproven(BTreeMap<u64, (usize, usize)>);

impl Unproven {
    /// Records that results of these servers were returned; only the `doubtful` ones can be confused.
    pub fn handed_out(&mut self, authors: impl IntoIterator<Item = u64>, doubtful: &BTreeSet<u64>) {
        for id in authors.into_iter().filter(|id| doubtful.contains(id)) {
            self.0.entry(id).or_default().1 += 1;
        }
    }

    /// Records that only one server answered for an id in a whole round, so no other server had the id until then.
    pub fn proven(&mut self, id: u64) {
        if let Some((before, since)) = self.0.get_mut(&id) {
            (*before, *since) = (*since, 0);
        }
    }

    /// Takes the number of unproven results of an id.
    pub fn take(&mut self, id: u64) -> usize {
        let (before, since) = self.0.remove(&id).unwrap_or_default();
        before + since
    }
}
