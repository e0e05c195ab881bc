//! Fleets of extended servers with a tool.

use swarmwright_pool::{Faults, Mode, Work};

use super::{Extended, Line, Net, Party, server, tool, tool_in_mode, tool_with_faults, work};

pub const SEEDS: [u64; 3] = [3, 4, 9];
pub const CANDIDATES: usize = 40;

pub fn undisturbed(candidates: usize) -> Vec<f64> {
    let mut net = Net::new(0);
    let now = net.now;
    let index = net.add(Party::Tool(Box::new(tool("a", 0, now))));
    net.add(Party::Server(Box::new(server(1, Line::new()))));
    net.submit(index, work(candidates, &SEEDS));
    net.finish(index)
}

pub fn batched(id: u64) -> Extended {
    Extended::new(id, &["stepwise", "batched"])
}

pub fn offloaded(id: u64) -> Extended {
    Extended::new(id, &["stepwise", "batched", "offloaded"])
}

/// Adds a tool and submits work to it.
pub fn begin(net: &mut Net, mode: Mode, work: Work) -> usize {
    let tool = tool_in_mode(mode, "a", 0, net.now);
    let index = net.add(Party::Tool(Box::new(tool)));
    net.submit(index, work);
    index
}

pub fn begin_with(net: &mut Net, faults: Faults, work: Work) -> usize {
    let tool = tool_with_faults(faults, "a", 0, net.now);
    let index = net.add(Party::Tool(Box::new(tool)));
    net.submit(index, work);
    index
}

pub fn begin_without_copies(net: &mut Net, work: Work) -> usize {
    let faults = Faults {
        backup: false,
        ..Faults::default()
    };
    begin_with(net, faults, work)
}

pub fn party(net: &mut Net, index: usize) -> &mut Extended {
    match &mut net.parties[index] {
        Party::Extended(server) => server,
        _ => panic!("party {index} is no extended server"),
    }
}
