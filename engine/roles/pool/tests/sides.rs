//! Sides of a match: servers announce them, and tools know who announced which.

use crate::common;

use std::time::Duration;

use common::{Line, Net, Party, server, tool_in_mode, work};
use swarmwright_pool::Mode;
use swarmwright_protocol::{AnnouncedSide, Topics};
use swarmwright_worlds::{Description, ParameterError, Parameters, Side, Simulation};
use swarmwright_wrapper::{Identity, Machine};

/// A line on which two groups compete.
struct Match(Line);

impl Simulation for Match {
    fn description(&self) -> Description {
        self.0.description()
    }

    fn sides(&self) -> Vec<Side> {
        let rest = Side {
            fitness: None,
            ..Side::new("rest", &["slow", "slower"], "")
        };
        vec![Side::new("left", &["fast"], "half"), rest]
    }

    fn reset(&mut self, parameters: &Parameters) -> Result<(), ParameterError> {
        self.0.reset(parameters)
    }

    fn acting(&self) -> &[u32] {
        self.0.acting()
    }

    fn sense(&self, agent: u32, sensors: &mut [f32]) {
        self.0.sense(agent, sensors);
    }

    fn step(&mut self, actuators: &[f32]) {
        self.0.step(actuators);
    }

    fn fitness(&self) -> f64 {
        self.0.fitness()
    }
}

#[test]
fn a_tool_knows_the_sides_that_each_server_announces() {
    let mut net = Net::new(1);
    net.add(Party::Server(Box::new(server(1, Line::new()))));
    let simulations: Vec<Box<dyn Simulation>> = vec![Box::new(Match(Line::new()))];
    let machine = Machine::new(
        Identity::new(2),
        simulations,
        Topics::default(),
        Duration::from_secs(20),
    );
    net.add(Party::Server(Box::new(machine)));
    let tool = tool_in_mode(Mode::Stepwise, "a", 0, net.now);
    let index = net.add(Party::Tool(Box::new(tool)));
    net.submit(index, work(2, &[3, 4]));
    net.finish(index);
    let side = |name: &str, groups: &[&str], fitness: Option<&str>| AnnouncedSide {
        name: name.to_owned(),
        groups: groups.iter().map(ToString::to_string).collect(),
        fitness: fitness.map(str::to_owned),
    };
    let sides = [
        side("left", &["fast"], Some("half")),
        side("rest", &["slow", "slower"], None),
    ];
    assert_eq!(net.tool(index).sides(), [(1, &[][..]), (2, &sides[..])]);
}
