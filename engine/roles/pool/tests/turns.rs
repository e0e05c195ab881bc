//! Optimization tools that want the same servers.

use crate::common;

use common::{Line, Net, Party, server, tool_in_mode, work};
use swarmwright_pool::Mode;

const SEEDS: [u64; 3] = [3, 4, 9];
const CANDIDATES: usize = 4000;

/// Returns the progress of each tool when the first one has finished, and when all have.
fn shared(mode: Mode, servers: u64, tools: u64) -> Vec<usize> {
    let mut net = Net::new(5);
    net.presence = true;
    for id in 0..servers {
        net.add(Party::Server(Box::new(server(id, Line::new()))));
    }
    let names = ["a", "b", "c"];
    let all: Vec<usize> = (0..tools)
        .zip(names)
        .map(|(number, name)| {
            let tool = tool_in_mode(mode, name, number << 40, net.now);
            net.add(Party::Tool(Box::new(tool)))
        })
        .collect();
    for &index in &all {
        net.submit(index, work(CANDIDATES, &SEEDS));
    }
    let mut then = Vec::new();
    for turn in 0..20_000_000 {
        net.turn();
        if turn % 100 == 0 {
            net.tick();
        }
        if all.iter().any(|&index| net.tool(index).finished()) {
            then = all.iter().map(|&index| net.tool(index).done()).collect();
            break;
        }
    }
    let expected = net.finish(all[0]);
    for &index in &all[1..] {
        assert_eq!(net.finish(index), expected);
    }
    then
}

#[test]
fn tools_that_share_servers_have_their_turns() {
    for (mode, servers, tools) in [
        (Mode::Stepwise, 1, 2),
        (Mode::Stepwise, 2, 3),
        (Mode::Batched, 1, 2),
    ] {
        let done = shared(mode, servers, tools);
        let (least, most) = (done.iter().min(), done.iter().max());
        assert_eq!(most, Some(&(CANDIDATES * SEEDS.len())), "{done:?}");
        assert!(
            least.is_some_and(|least| 4 * least > CANDIDATES * SEEDS.len()),
            "{mode:?}, {servers} servers: {done:?}"
        );
    }
}
