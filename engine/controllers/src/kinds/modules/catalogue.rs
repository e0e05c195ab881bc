//! The modules: a line for each behaviour and each condition. Their numbers are their places in these lists.

/// What a state does.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Behaviour {
    /// Straight ahead; an obstacle in front makes it turn on the spot for a random time.
    Explore,
    /// Stays where it is.
    Stop,
    /// Follows a sum of vectors.
    Follow(Pull),
}

/// What the vectors are multiplied by before they are added.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Pull {
    pub(super) light: f32,
    /// Of what attracts to neighbours, times the state's parameter alpha ...
    pub(super) neighbours: f32,
    /// ... and times its square.
    pub(super) squared: f32,
    pub(super) obstacles: f32,
}

const fn follow(light: f32, neighbours: f32, squared: f32, obstacles: f32) -> Behaviour {
    Behaviour::Follow(Pull {
        light,
        neighbours,
        squared,
        obstacles,
    })
}

pub(super) const BEHAVIOURS: [(&str, Behaviour); 6] = [
    ("exploration", Behaviour::Explore),
    ("stop", Behaviour::Stop),
    ("phototaxis", follow(1.0, 0.0, 0.0, -5.0)),
    ("anti_phototaxis", follow(-1.0, 0.0, 0.0, -5.0)),
    ("attraction", follow(0.0, 1.0, 0.0, -6.0)),
    ("repulsion", follow(0.0, 0.0, -1.0, -5.0)),
];

/// When a transition is made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Condition {
    /// On ground of this colour, with a probability.
    Ground(Ground),
    /// With a probability that grows with the number of neighbours.
    Neighbours,
    /// With a probability that shrinks with the number of neighbours.
    FewNeighbours,
    /// With a probability.
    Fixed,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Ground {
    Black,
    Grey,
    White,
}

pub(super) const CONDITIONS: [(&str, Condition); 6] = [
    ("black_floor", Condition::Ground(Ground::Black)),
    ("grey_floor", Condition::Ground(Ground::Grey)),
    ("white_floor", Condition::Ground(Ground::White)),
    ("neighbours", Condition::Neighbours),
    ("few_neighbours", Condition::FewNeighbours),
    ("fixed_probability", Condition::Fixed),
];

/// Names in the order of their numbers.
pub(super) const fn names<T: Copy, const N: usize>(
    of: &[(&'static str, T); N],
) -> [&'static str; N] {
    let mut names = [""; N];
    let mut index = 0;
    while index < N {
        names[index] = of[index].0;
        index += 1;
    }
    names
}
