//! Collisions as measured in ARGoS 3, where wheels had no noise: the private part is compiled here.

#![allow(dead_code, clippy::unwrap_used, reason = "only collisions are wanted")]

use swarmwright_lanes::{Lanes, number};

#[path = "../src/contacts"]
mod contacts {
    pub mod contact;
    pub mod near;
    mod pairs;
    pub mod solver;
    mod walls;
}

#[path = "../src/math"]
mod math {
    pub mod functions;
    pub mod random;
}
#[path = "../src/time.rs"]
mod time;

#[path = "../src/place"]
mod place {
    mod face;

    pub(crate) use face::{Face, to_face};

    /// As in the library, with walls alone.
    pub(crate) struct Place {
        pub faces: Vec<Face>,
    }
}
mod robots {
    pub struct Rays {
        pub start: f32,
        pub range: f32,
    }

    /// As the e-puck in the library.
    pub struct Robot {
        pub radius: f32,
        pub acceleration: f32,
        pub friction: [f32; 2],
        pub proximity: Option<Rays>,
    }

    impl Robot {
        pub fn reach(&self) -> f32 {
            0.03
        }

        pub fn fastest(&self) -> f32 {
            0.3
        }
    }

    #[derive(Clone, Copy)]
    pub struct Pair {
        pub limit: f32,
        pub smaller: f32,
        pub reach: f32,
        pub share: f32,
        pub lightness: [f32; 2],
        pub friction: f32,
        pub same: Option<f32>,
    }

    /// As in the library, with one kind.
    pub struct Team(pub Robot);

    impl Team {
        pub fn robot(&self, _: usize) -> &Robot {
            &self.0
        }

        pub fn pair(&self, _: usize, _: usize) -> Pair {
            let limit = 2.0 * self.0.radius;
            Pair {
                limit,
                smaller: self.0.radius,
                reach: limit + self.0.reach(),
                share: 0.5,
                lightness: [1.0; 2],
                friction: self.0.friction[0],
                same: Some(self.0.radius),
            }
        }

        pub fn group(&self, _: usize) -> usize {
            0
        }

        pub fn equal(&self) -> bool {
            true
        }

        pub fn uneven(&self) -> bool {
            false
        }

        pub fn gap(&self) -> f32 {
            self.0.reach()
        }

        pub fn fastest(&self) -> f32 {
            self.0.fastest()
        }
    }
}

mod bodies {
    use swarmwright_lanes::{Lanes, Number};

    use super::contacts::near::Moved;
    use super::place::Place;
    use super::robots::Team;

    /// As in the library.
    pub const FASTEST: f32 = 50.0;

    /// As in the library where there is none.
    pub struct Objects<L>(std::marker::PhantomData<L>);

    impl<L> Default for Objects<L> {
        fn default() -> Self {
            Self(std::marker::PhantomData)
        }
    }

    impl<L: Lanes> Objects<L> {
        pub fn find(&mut self, _: &Bodies<L>, _: &Team, _: &Place, _: &mut [u64]) {}

        pub fn any(&self) -> bool {
            false
        }

        pub fn awake(&self) -> bool {
            false
        }

        pub fn begin(&mut self, _: &mut [Moved<L>], _: (&Team, &Place)) {}

        pub fn rest(&mut self, _: bool) {}

        pub fn solve(&mut self, _: &mut [Moved<L>], _: &Team) {}

        pub fn advance(&mut self, _: &Team) {}
    }

    /// As in the library, without headings.
    pub struct Bodies<L> {
        pub x: Vec<Number<L>>,
        pub y: Vec<Number<L>>,
        pub vx: Vec<Number<L>>,
        pub vy: Vec<Number<L>>,
        pub spin: Vec<Number<L>>,
        pub objects: Objects<L>,
    }

    impl<L: Lanes> Bodies<L> {
        pub fn len(&self) -> usize {
            self.x.len()
        }

        pub fn between(&self, from: usize, to: usize) -> [Number<L>; 2] {
            [self.x[to] - self.x[from], self.y[to] - self.y[from]]
        }
    }
}

/// Ticks in which the wheels turn.
const TICKS: u32 = 79;

/// A robot: where it starts, degrees, m/s, and where it is in ARGoS after 8 s.
type Run = ([f32; 2], f32, f32, [f32; 2]);

/// Where robots are after 8 s beside a wall at x = 1.226.
fn driven<L: Lanes>(runs: &[Run]) -> Vec<[f32; 2]> {
    let team = robots::Team(robots::Robot {
        radius: 0.035,
        acceleration: 3.75,
        friction: [0.49, 0.07],
        proximity: None,
    });
    let wall = place::Face {
        middle: [1.226, 0.0],
        along: [0.0, 1.0],
        half: 0.33,
        height: 1.0,
        outer: false,
    };
    let layout = place::Place { faces: vec![wall] };
    let all = |of: fn(&Run) -> f32| runs.iter().map(|run| number::<L>(of(run))).collect();
    let mut bodies = bodies::Bodies {
        x: all(|run| run.0[0]),
        y: all(|run| run.0[1]),
        vx: all(|_| 0.0),
        vy: all(|_| 0.0),
        spin: all(|_| 0.0),
        objects: bodies::Objects::default(),
    };
    let count = runs.len() as u32;
    let pairs = (0..count).flat_map(|i| (i + 1..count).map(move |j| [i, j]));
    let close = contacts::near::Close {
        robots: pairs.collect(),
        faces: (0..count).map(|robot| [robot, 0]).collect(),
    };
    let mut contacts = contacts::solver::Contacts::<L>::new(runs.len());
    for (aim, (_, degrees, speed, _)) in contacts.aim.iter_mut().zip(runs) {
        let (sin, cos) = degrees.to_radians().sin_cos();
        *aim = [number(speed * cos), number(speed * sin)];
    }
    for _ in 0..TICKS {
        contacts.resolve(&mut bodies, &close, &team, &layout);
    }
    let of = |number: swarmwright_lanes::Number<L>| {
        let mut lanes = [0.0; swarmwright_lanes::MOST_LANES];
        number.store(&mut lanes);
        lanes[0]
    };
    let places = bodies.x.iter().zip(&bodies.y);
    places.map(|(x, y)| [of(*x), of(*y)]).collect()
}

#[test]
fn robots_push_as_in_argos() {
    let cases: [(&str, &[Run], f32); 6] = [
        (
            "one pushes an idle one, at half its speed",
            &[
                ([-0.3, 0.0], 0.0, 0.12, [0.28845, 0.0]),
                ([0.0, 0.01], 57.3, 0.0, [0.357, 0.01]),
            ],
            0.0003,
        ),
        (
            "the faster of two that meet goes on, at the speed of the other",
            &[
                ([-0.3, 0.0], 0.0, 0.12, [0.13025, 0.0]),
                ([0.0, 0.0], 180.0, 0.04, [0.19962, 0.0]),
            ],
            0.0003,
        ),
        (
            "equal ones stop each other",
            &[
                ([-0.3, 0.0], 0.0, 0.12, [-0.03495, 0.0]),
                ([0.3, 0.0], 180.0, 0.12, [0.03495, 0.0]),
            ],
            0.0003,
        ),
        (
            "two push an idle one at their speed",
            &[
                ([-0.3, 0.03], 0.0, 0.12, [0.61755, 0.0303]),
                ([-0.3, -0.06], 0.0, 0.12, [0.64527, -0.06012]),
                ([0.0, 0.0], 0.0, 0.0, [0.6801, 0.0003]),
            ],
            0.002,
        ),
        (
            "a row is pressed against a wall",
            &[
                ([0.8, 0.0], 0.0, 0.12, [1.05427, 0.0]),
                ([0.9, 0.0], 0.0, 0.12, [1.12306, 0.0]),
                ([1.0, 0.005], 0.0, 0.12, [1.19185, 0.005]),
            ],
            0.003,
        ),
        (
            "one slides along a wall",
            &[([0.9, -0.2], 30.0, 0.12, [1.19189, 0.23584])],
            0.0003,
        ),
    ];
    for (name, runs, tolerance) in cases {
        for (found, (.., expected)) in driven::<f32>(runs).iter().zip(runs) {
            let off = (found[0] - expected[0]).hypot(found[1] - expected[1]);
            assert!(off < tolerance, "{name}: {found:?}, in ARGoS {expected:?}");
        }
    }
}
