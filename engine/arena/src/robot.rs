//! Models of robots: body, drive, sensors, and what controllers get of them.

/// A ray in the frame of the robot, x ahead, y to the left.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Ray {
    /// Unit vector.
    pub along: [f32; 2],
    /// The angle that controllers are told, half turns counter-clockwise from ahead.
    pub reported: f32,
}

/// Proximity sensors: rays that see bodies and walls.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Proximity {
    pub rays: Vec<Ray>,
    /// Whether each ray of the first half has its opposite in the second one: what one of them meets the other does not.
    pub opposed: bool,
    /// Where rays begin, metres from the middle.
    pub start: f32,
    /// How far they see from there, metres.
    pub range: f32,
    /// A reading is c0 + c1 d + c2 d^2 of the distance d, limited to 0..=1.
    pub response: [f32; 3],
    /// Uniform noise of +-this, after which the reading is limited again.
    pub noise: f32,
}

impl Proximity {
    /// Rays of which one in each pair of opposites is, else all.
    #[inline(always)]
    pub(super) fn halves(&self) -> usize {
        if self.opposed {
            self.rays.len() / 2
        } else {
            self.rays.len()
        }
    }

    /// The ray opposite to one of the first half.
    #[inline(always)]
    pub(super) fn opposite(&self, ray: usize) -> Option<usize> {
        self.opposed.then_some(ray + self.rays.len() / 2)
    }
}

/// Light sensors.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct LightSensors {
    /// Half turns counter-clockwise from ahead.
    pub angles: Vec<f32>,
    /// Distance divided by intensity up to which light is seen.
    pub reach: f32,
    /// Uniform noise.
    pub noise: f32,
}

/// Sensors that look at the floor.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct GroundSensors {
    /// Places in the frame of the robot, metres.
    pub points: Vec<[f32; 2]>,
    /// Uniform noise.
    pub noise: f32,
}

/// Range and bearing of neighbours.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Links {
    /// Largest distance of middles, metres.
    pub range: f32,
    /// Probability that a message is lost, drawn for each link and tick.
    pub loss: f32,
    /// What is subtracted from the distance, centimetres.
    pub offset: f32,
}

/// Numbers that controllers get, in the order of a model's list.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Output {
    /// The reading of each proximity sensor, 0..=1.
    Proximity,
    /// The sum of proximity readings along their rays, at most of length 1: x, y.
    ProximityVector,
    /// The reading of each light sensor, 0..=1.
    Light,
    /// The direction of light, of length 1, or 0, 0 where no reading is above 0.2: x, y.
    LightDirection,
    /// Three numbers: 0 on black, 1 on white, and on grey draws around 0.407, 0.342 and 0.423.
    GroundDrawn,
    /// 0 on black, 0.5 on grey, 1 on white.
    Ground,
    /// Number of robots heard in this tick.
    Neighbours,
    /// 1 - 2 / (1 + e^n) of the robots n heard in this tick.
    NeighboursSquashed,
    /// Sum of 1 / (1 + range in cm) along the bearings of the messages of the last 11 ticks: x, y.
    Attraction,
    /// The same, squashed to the length tanh(length / 2), along 45, 135, 225 and 315 degrees; 0 where that is negative.
    AttractionParts,
    /// A number in 0..1, drawn anew in each tick.
    Random,
}

/// A model of a robot.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Robot {
    /// Metres.
    pub radius: f32,
    /// Metres; what lies lower does not hide it.
    pub height: f32,
    /// Distance of the wheels, metres.
    pub wheel_base: f32,
    /// Largest speed of a wheel, m/s: actuators of 1.
    pub top_speed: f32,
    /// Standard deviation of the factor by which a wheel's speed is off in a tick.
    pub wheel_noise: f32,
    /// Largest change of velocity by the drive, m/s^2.
    pub acceleration: f32,
    /// Coefficient of friction between robots, and with walls.
    pub friction: [f32; 2],
    pub proximity: Option<Proximity>,
    pub light: Option<LightSensors>,
    pub ground: Option<GroundSensors>,
    pub links: Option<Links>,
    pub outputs: Vec<Output>,
}

/// Degrees in half turns.
const fn half_turns(degrees: f32) -> f32 {
    if degrees > 180.0 {
        (degrees - 360.0) / 180.0
    } else {
        degrees / 180.0
    }
}

/// Where the e-puck's manual says that its proximity and light sensors look, degrees counter-clockwise from ahead.
const E_PUCK_ANGLES: [f32; 8] = [17.0, 50.0, 90.0, 150.0, 210.0, 270.0, 310.0, 343.0];

impl Robot {
    /// The e-puck with reference model RM1.1 or, with what Chocolate's modules get, RM1.2 (`../shared/data/argos`).
    pub(super) fn e_puck(outputs: Vec<Output>) -> Self {
        let rays = (0..8).map(|index| {
            // Opposites are so to the last bit.
            let angle = f64::from(index % 4) * 45.0 + 11.25;
            let (sin, cos) = angle.to_radians().sin_cos();
            let sign = if index < 4 { 1.0 } else { -1.0 };
            Ray {
                along: [cos as f32 * sign, sin as f32 * sign],
                reported: half_turns(E_PUCK_ANGLES[index as usize]),
            }
        });
        Self {
            radius: 0.035,
            height: 0.076,
            wheel_base: 0.053,
            top_speed: 0.12,
            wheel_noise: 0.05,
            acceleration: 3.75,
            friction: [0.49, 0.07],
            proximity: Some(Proximity {
                rays: rays.collect(),
                opposed: true,
                start: 0.036,
                range: 0.05,
                response: [1.08212, -36.8961, 298.701],
                noise: 0.05,
            }),
            light: Some(LightSensors {
                angles: E_PUCK_ANGLES.map(half_turns).to_vec(),
                reach: 2.5,
                noise: 0.05,
            }),
            ground: Some(GroundSensors {
                points: vec![[0.03, -0.009], [0.03, 0.0], [0.03, 0.009]],
                noise: 0.05,
            }),
            links: Some(Links {
                range: 0.7,
                loss: 0.85,
                offset: 7.0,
            }),
            outputs,
        }
    }

    /// The model with this name.
    pub(super) fn preset(name: &str) -> Option<Self> {
        use Output::*;
        match name {
            "e-puck-rm1.1" => Some(Self::e_puck(vec![
                Proximity,
                Light,
                GroundDrawn,
                NeighboursSquashed,
                AttractionParts,
            ])),
            "e-puck-rm1.2" => Some(Self::e_puck(vec![
                ProximityVector,
                LightDirection,
                Ground,
                Neighbours,
                Attraction,
                Random,
            ])),
            _ => None,
        }
    }

    /// Names of the models.
    pub(super) const PRESETS: [&str; 2] = ["e-puck-rm1.1", "e-puck-rm1.2"];

    /// How many numbers an output has.
    pub(super) fn width(&self, output: Output) -> usize {
        match output {
            Output::Proximity => self.proximity.as_ref().map_or(0, |p| p.rays.len()),
            Output::Light => self.light.as_ref().map_or(0, |l| l.angles.len()),
            Output::GroundDrawn => 3,
            Output::AttractionParts => 4,
            Output::ProximityVector | Output::LightDirection | Output::Attraction => 2,
            Output::Ground | Output::Neighbours | Output::NeighboursSquashed | Output::Random => 1,
        }
    }

    /// The names of the numbers that controllers get.
    pub(super) fn sensor_names(&self) -> Vec<String> {
        let mut names = Vec::new();
        for output in &self.outputs {
            let parts: &[&str] = match output {
                Output::Proximity => {
                    names.extend(numbered("proximity", self.width(*output)));
                    continue;
                }
                Output::Light => {
                    names.extend(numbered("light", self.width(*output)));
                    continue;
                }
                Output::ProximityVector => &["proximity x", "proximity y"],
                Output::LightDirection => &["light x", "light y"],
                Output::GroundDrawn => &["ground left", "ground middle", "ground right"],
                Output::Ground => &["ground"],
                Output::Neighbours => &["neighbours"],
                Output::NeighboursSquashed => &["neighbours squashed"],
                Output::Attraction => &["attraction x", "attraction y"],
                Output::AttractionParts => &[
                    "attraction 45",
                    "attraction 135",
                    "attraction 225",
                    "attraction 315",
                ],
                Output::Random => &["random"],
            };
            names.extend(parts.iter().map(|name| (*name).to_owned()));
        }
        names
    }

    /// How far anything of another robot matters to the sensors, metres from middle to middle.
    pub(super) fn range(&self) -> f32 {
        let proximity = self.proximity.as_ref();
        let proximity = proximity.map_or(0.0, |p| p.start + p.range + self.radius);
        self.links
            .as_ref()
            .map_or(0.0, |links| links.range)
            .max(proximity)
    }

    /// Numbers that controllers get.
    pub(super) fn sensors(&self) -> usize {
        self.outputs.iter().map(|output| self.width(*output)).sum()
    }
}

/// A name for each of several sensors of a kind.
fn numbered(name: &str, count: usize) -> impl Iterator<Item = String> + '_ {
    (0..count).map(move |index| format!("{name} {index}"))
}
