//! Missions: a place, where robots start, what is measured, and what is to be reached.

use std::collections::BTreeMap;

use serde::Deserialize;
use serde_json::Value;

use super::metrics::Metric;
use super::place::{Face, Light, Patch, Place, Shape};
use super::start::Start;
use swarmwright_simulation::ParameterError;
use swarmwright_simulation::parameters::wrong;

/// Built-in missions: a file each.
const MISSIONS: [(&str, &str); 14] = [
    ("aac", include_str!("missions/aac.yaml")),
    ("cfa", include_str!("missions/cfa.yaml")),
    ("decision", include_str!("missions/decision.yaml")),
    (
        "directional_gate",
        include_str!("missions/directional_gate.yaml"),
    ),
    ("foraging", include_str!("missions/foraging.yaml")),
    (
        "grid_exploration",
        include_str!("missions/grid_exploration.yaml"),
    ),
    (
        "guided_shelter",
        include_str!("missions/guided_shelter.yaml"),
    ),
    ("homing", include_str!("missions/homing.yaml")),
    ("lcn", include_str!("missions/lcn.yaml")),
    ("sca", include_str!("missions/sca.yaml")),
    ("spc", include_str!("missions/spc.yaml")),
    ("stop", include_str!("missions/stop.yaml")),
    ("two_spots", include_str!("missions/two_spots.yaml")),
    ("two_spots_sum", include_str!("missions/two_spots_sum.yaml")),
];

/// A mission, checked.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Mission {
    pub title: String,
    /// Number of robots where the parameter `robots` is left out.
    pub robots: u32,
    /// Seconds, where the parameter `duration` is left out.
    pub duration: f64,
    /// Model of the robots, where the parameter `robot` is left out.
    pub robot: String,
    pub place: Place,
    pub start: Start,
    /// In the order of their names.
    pub metrics: Vec<(String, Metric)>,
    /// The fitness: this number, and for each metric its value times a factor.
    pub offset: f64,
    pub factors: Vec<f64>,
}

/// A mission as it is written.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Text {
    title: Option<String>,
    #[serde(default = "twenty")]
    robots: u32,
    #[serde(default = "two_minutes")]
    duration: f64,
    #[serde(default = "e_puck")]
    robot: String,
    walls: Walls,
    #[serde(default)]
    obstacles: Vec<Obstacle>,
    #[serde(default)]
    floor: Floor,
    #[serde(default)]
    lights: Vec<Lamp>,
    start: StartText,
    metrics: BTreeMap<String, Metric>,
    fitness: Fitness,
}

fn twenty() -> u32 {
    20
}

fn two_minutes() -> f64 {
    120.0
}

fn e_puck() -> String {
    "e-puck-rm1.1".to_owned()
}

fn wall_height() -> f32 {
    0.08
}

/// The walls around.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Walls {
    /// A regular polygon around the origin, with a side across the x axis ...
    sides: Option<u32>,
    /// ... and this distance of its sides from the middle, metres.
    apothem: Option<f32>,
    /// Width and height of a rectangle around the origin, metres.
    rectangle: Option<[f32; 2]>,
    /// Corners of a polygon in order.
    corners: Option<Vec<[f32; 2]>>,
    #[serde(default = "wall_height")]
    height: f32,
}

/// A box that stands in the arena.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Obstacle {
    center: [f32; 2],
    /// Extent along x and y before it is turned, metres.
    size: [f32; 2],
    /// Degrees counter-clockwise.
    #[serde(default)]
    angle: f32,
    #[serde(default = "wall_height")]
    height: f32,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Floor {
    #[serde(default = "grey")]
    color: Color,
    #[serde(default)]
    patches: Vec<PatchText>,
}

impl Default for Floor {
    fn default() -> Self {
        Self {
            color: grey(),
            patches: Vec::new(),
        }
    }
}

fn grey() -> Color {
    Color::Named(Named::Grey)
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct PatchText {
    name: String,
    circle: Option<Circle>,
    rectangle: Option<Rectangle>,
    /// Corners of a convex polygon, counter-clockwise.
    polygon: Option<Vec<[f32; 2]>>,
    color: Color,
}

#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct Circle {
    #[serde(default)]
    center: [f32; 2],
    radius: f32,
}

#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct Rectangle {
    /// Left and right end; .inf where there is none.
    x: [f32; 2],
    /// Lower and upper end.
    y: [f32; 2],
}

/// The colour of a floor.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(untagged)]
enum Color {
    Named(Named),
    /// 0 black to 1 white.
    Level(f32),
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Named {
    Black,
    Grey,
    White,
    /// Black or white by the seed of the episode.
    Random,
}

impl Color {
    fn level(self) -> Option<f32> {
        match self {
            Self::Named(Named::Black) => Some(0.0),
            // 127 of 255, as in ARGoS.
            Self::Named(Named::Grey) => Some(0.498_039_22),
            Self::Named(Named::White) => Some(1.0),
            Self::Named(Named::Random) => None,
            Self::Level(level) => Some(level),
        }
    }
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Lamp {
    at: [f32; 3],
    intensity: f32,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct StartText {
    disc: Option<Circle>,
    rectangle: Option<Rectangle>,
}

#[derive(Debug, Deserialize)]
#[serde(untagged)]
enum Fitness {
    /// The value of a metric.
    Metric(String),
    /// A number and a factor for each of some metrics.
    Sum {
        #[serde(default)]
        offset: f64,
        factors: BTreeMap<String, f64>,
    },
}

impl Mission {
    /// The mission of the parameter `mission`: the name of a built-in one, or an object.
    pub(super) fn read(value: Option<&Value>) -> Result<Self, ParameterError> {
        match value {
            None => Self::named("aac"),
            Some(Value::String(name)) => Self::named(name),
            Some(object @ Value::Object(_)) => {
                let text = serde_path_to_error::deserialize(object).map_err(|error| {
                    let path = error.path().to_string();
                    let name = if path == "." {
                        "mission".to_owned()
                    } else {
                        format!("mission.{path}")
                    };
                    wrong(&name, error.inner().to_string())
                })?;
                Self::check(text)
            }
            Some(other) => Err(wrong(
                "mission",
                format!("{other} found, expected {}", Self::expected()),
            )),
        }
    }

    /// The fitness, from the values of the metrics.
    pub(super) fn fitness(&self, value: impl Fn(usize) -> f64) -> f64 {
        let factors = self.factors.iter().enumerate();
        // What does not count may be anything, infinite too.
        factors
            .filter(|(_, factor)| **factor != 0.0)
            .fold(self.offset, |sum, (metric, factor)| {
                sum + factor * value(metric)
            })
    }

    fn expected() -> String {
        let names: Vec<_> = MISSIONS.iter().map(|(name, _)| *name).collect();
        format!("the name of a mission ({}) or an object", names.join(", "))
    }

    fn named(name: &str) -> Result<Self, ParameterError> {
        let found = MISSIONS.iter().find(|(known, _)| *known == name);
        let Some((_, text)) = found else {
            return Err(wrong(
                "mission",
                format!("{name:?} found, expected {}", Self::expected()),
            ));
        };
        let text =
            serde_saphyr::from_str(text).map_err(|error| wrong("mission", error.to_string()))?;
        Self::check(text)
    }

    fn check(text: Text) -> Result<Self, ParameterError> {
        let mut place = Place {
            faces: walls(&text.walls)?,
            patches: Vec::new(),
            grey: text
                .floor
                .color
                .level()
                .ok_or_else(|| wrong("mission.floor.color", "only patches can be random"))?,
            lights: Vec::new(),
        };
        for (index, obstacle) in text.obstacles.iter().enumerate() {
            if obstacle.size.iter().any(|size| *size <= 0.0) {
                return Err(wrong(
                    &format!("mission.obstacles[{index}].size"),
                    "expected two numbers above 0",
                ));
            }
            place.faces.extend(faces(obstacle));
        }
        for (index, patch) in text.floor.patches.into_iter().enumerate() {
            let shape = match (patch.circle, patch.rectangle, patch.polygon) {
                (None, None, Some(corners)) if corners.len() > 2 => Shape::Polygon { corners },
                (Some(circle), None, None) => Shape::Circle {
                    center: circle.center,
                    radius: circle.radius,
                },
                (None, Some(Rectangle { x, y }), None) => Shape::Box {
                    low: [x[0], y[0]],
                    high: [x[1], y[1]],
                },
                _ => {
                    return Err(wrong(
                        &format!("mission.floor.patches[{index}]"),
                        "expected circle, or rectangle, or polygon with at least 3 corners",
                    ));
                }
            };
            place.patches.push(Patch {
                name: patch.name,
                shape,
                grey: patch.color.level(),
            });
        }
        place.lights = text
            .lights
            .into_iter()
            .map(|lamp| Light {
                at: lamp.at,
                intensity: lamp.intensity,
            })
            .collect();
        let start = Start {
            disc: text.start.disc.map(|disc| (disc.center, disc.radius)),
            rectangle: text
                .start
                .rectangle
                .map(|Rectangle { x, y }| ([x[0], y[0]], [x[1], y[1]])),
        };
        if start.disc.is_none() && start.rectangle.is_none() {
            return Err(wrong(
                "mission.start",
                "expected disc, or rectangle, or both: the part of the disc in the rectangle",
            ));
        }
        let metrics: Vec<(String, Metric)> = text.metrics.into_iter().collect();
        for (name, metric) in &metrics {
            metric
                .check(&place)
                .map_err(|reason| wrong(&format!("mission.metrics.{name}"), reason))?;
        }
        let mut factors = vec![0.0; metrics.len()];
        let (offset, given) = match text.fitness {
            Fitness::Metric(name) => (0.0, BTreeMap::from([(name, 1.0)])),
            Fitness::Sum { offset, factors } => (offset, factors),
        };
        for (name, factor) in given {
            let Some(index) = metrics.iter().position(|(known, _)| *known == name) else {
                let names: Vec<_> = metrics.iter().map(|(name, _)| name.as_str()).collect();
                return Err(wrong(
                    "mission.fitness",
                    format!("no metric is named {name:?}; there is {}", names.join(", ")),
                ));
            };
            factors[index] = factor;
        }
        Ok(Self {
            title: text.title.unwrap_or_else(|| "Arena".to_owned()),
            robots: text.robots,
            duration: text.duration,
            robot: text.robot,
            place,
            start,
            metrics,
            offset,
            factors,
        })
    }
}

/// The faces of the walls around, each with its normal, left of its direction, pointing inwards.
fn walls(walls: &Walls) -> Result<Vec<Face>, ParameterError> {
    let corners = match (walls.sides, walls.apothem, walls.rectangle, &walls.corners) {
        (Some(sides), Some(apothem), None, None) => {
            if !(3..=1000).contains(&sides) {
                return Err(wrong("mission.walls.sides", "expected 3 to 1000"));
            }
            let radius = f64::from(apothem) / (std::f64::consts::PI / f64::from(sides)).cos();
            (0..sides)
                .map(|corner| {
                    let angle = (f64::from(corner) - 0.5) / f64::from(sides);
                    let (sin, cos) = (2.0 * std::f64::consts::PI * angle).sin_cos();
                    [(radius * cos) as f32, (radius * sin) as f32]
                })
                .collect()
        }
        (None, None, Some([width, height]), None) => {
            let [x, y] = [width / 2.0, height / 2.0];
            vec![[-x, -y], [x, -y], [x, y], [-x, y]]
        }
        (None, None, None, Some(corners)) => corners.clone(),
        _ => {
            return Err(wrong(
                "mission.walls",
                "expected sides and apothem, or rectangle, or corners",
            ));
        }
    };
    if corners.len() < 3 {
        return Err(wrong(
            "mission.walls.corners",
            "expected at least 3 corners",
        ));
    }
    Ok(sides(&corners, walls.height, true))
}

/// The sides of a polygon with counter-clockwise corners, seen from inside, or from outside.
fn sides(corners: &[[f32; 2]], height: f32, inside: bool) -> Vec<Face> {
    let next = corners.iter().cycle().skip(1);
    corners
        .iter()
        .zip(next)
        .map(|(from, to)| {
            if inside {
                Face::new(*from, *to, height, true)
            } else {
                Face::new(*to, *from, height, false)
            }
        })
        .collect()
}

/// The four sides of a box.
fn faces(obstacle: &Obstacle) -> Vec<Face> {
    let (sin, cos) = f64::from(obstacle.angle).to_radians().sin_cos();
    let [w, h] = obstacle.size.map(|size| f64::from(size) / 2.0);
    let corner = |x: f64, y: f64| {
        [
            (f64::from(obstacle.center[0]) + x * cos - y * sin) as f32,
            (f64::from(obstacle.center[1]) + x * sin + y * cos) as f32,
        ]
    };
    let corners = [corner(-w, -h), corner(w, -h), corner(w, h), corner(-w, h)];
    sides(&corners, obstacle.height, false)
}
