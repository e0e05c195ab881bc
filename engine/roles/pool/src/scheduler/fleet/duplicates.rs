//! Results of servers of which it is not sure that they alone have their id.

use std::collections::BTreeMap;

/// By id: results handed out since it was sure that one server alone has it, before and since its last answer.
#[derive(Debug, Default)]
pub(crate) struct Unproven(BTreeMap<u64, (usize, usize)>);

impl Unproven {
    /// A result of a server was handed out.
    pub fn handed_out(&mut self, id: u64) {
        self.0.entry(id).or_default().1 += 1;
    }

    /// Notes that a single server answered for an id in a whole round: until then no other server had the id.
    pub fn proven(&mut self, id: u64) {
        if let Some((before, since)) = self.0.get_mut(&id) {
            (*before, *since) = (*since, 0);
        }
    }

    /// How many results of an id are unproven; there are none then.
    pub fn take(&mut self, id: u64) -> usize {
        let (before, since) = self.0.remove(&id).unwrap_or_default();
        before + since
    }
}
