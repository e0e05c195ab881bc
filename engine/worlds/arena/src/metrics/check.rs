//! Checks that metrics are valid for their mission.

use swarmwright_simulation::ParameterError;
use swarmwright_simulation::parameters::wrong;

use super::formation::Formation;
use super::kind::Metric;
use crate::math::polygon;
use crate::place::{Place, Shape};

/// Maximum length, metres.
const LONGEST: f32 = 1000.0;
/// Maximum number of cells along a side, and on a floor.
const MOST_ALONG: u32 = 1000;
const MOST_CELLS: f32 = 1e6;
/// Maximum number of positions in a formation.
const MOST_POINTS: usize = 1000;

impl Metric {
    /// Checks the metric against the place; an error names the field.
    pub fn check(&self, layout: &Place) -> Result<(), ParameterError> {
        for (field, name) in self.patches() {
            if layout.patch(name).is_none() {
                let names = layout.patches.iter().map(|patch| patch.name.as_str());
                let names = listed(names);
                let reason = format!("no patch of the floor is named {name:?}; available: {names}");
                return Err(wrong(&field, reason));
            }
        }
        let needed = match self {
            Self::MostRobotsOn { patches, .. } => Some(("patches", patches)),
            Self::Returns { sources, .. } => Some(("sources", sources)),
            _ => None,
        };
        if let Some((field, names)) = needed
            && names.is_empty()
        {
            return Err(wrong(
                field,
                "an empty list found, expected at least one patch",
            ));
        }
        self.check_object(layout)?;
        let shape = |name: &str| layout.patch(name).map(|patch| &patch.shape);
        match self {
            Self::CellAge { side, cells } => {
                length("side", *side)?;
                if !(1..=MOST_ALONG).contains(cells) {
                    let reason = format!("{cells} found, expected 1 to {MOST_ALONG}");
                    return Err(wrong("cells", reason));
                }
            }
            Self::LargestGroupArea { link, disc, within } => {
                length("link", *link)?;
                length("disc", *disc)?;
                length("within", *within)?;
                if *within > 50.0 {
                    let reason = format!("{within} found, expected at most 50");
                    return Err(wrong("within", reason));
                }
            }
            Self::MeanDistance { radius, most, .. } => {
                length("radius", *radius)?;
                length("most", *most)?;
            }
            Self::MeanDistanceInside { patch, most } => {
                let ends = |low: &[f32; 2], high: &[f32; 2]| {
                    low.iter().chain(high).all(|number| number.is_finite())
                };
                if !matches!(shape(patch), Some(Shape::Box { low, high }) if ends(low, high)) {
                    let reason = format!("{patch} must be a rectangle with four ends");
                    return Err(wrong("patch", reason));
                }
                length("most", *most)?;
            }
            Self::MeanDistanceRim {
                patch,
                near: margin,
                most,
            } => {
                if !matches!(shape(patch), Some(Shape::Circle { .. })) {
                    return Err(wrong("patch", format!("{patch} must be a circle")));
                }
                length("near", *margin)?;
                length("most", *most)?;
            }
            Self::CrossingsSouth { patch } => {
                let ends = |low: f32, high: f32| low.is_finite() && high.is_finite();
                if !matches!(shape(patch), Some(Shape::Box { low, high }) if ends(low[1], high[1]))
                {
                    let reason =
                        format!("{patch} must be a rectangle with a lower and an upper end");
                    return Err(wrong("patch", reason));
                }
            }
            Self::LargestGroup { link, .. }
            | Self::Groups { link, .. }
            | Self::GroupSpeed {
                link: Some(link), ..
            } => length("link", *link)?,
            Self::CoveredShare { radius, .. } => length("radius", *radius)?,
            Self::VisitedShare { cell } | Self::PaintedShare { cell, .. } => {
                length("cell", *cell)?;
                let [low, high] = polygon::extent(&layout.outline);
                let cells = (0..2).map(|axis| (high[axis] - low[axis]) / cell);
                if cells.product::<f32>() > MOST_CELLS {
                    let reason =
                        format!("{cell} makes more than a million cells; use a larger one");
                    return Err(wrong("cell", reason));
                }
            }
            Self::ShapeDeviation { shape, .. } => shape.check()?,
            Self::RobotsInWrongHalf { patch }
                if shape(patch).is_some_and(|shape| !shape.middle()[1].is_finite()) =>
            {
                let reason = format!("{patch} must have a lower and an upper end");
                return Err(wrong("patch", reason));
            }
            Self::ObjectDistance { patch, .. } => has_middle(layout, "patch", patch)?,
            Self::TimeUntil {
                at_least, at_most, ..
            } => {
                let (field, share) = match (at_least, at_most) {
                    (Some(share), None) => ("at_least", *share),
                    (None, Some(share)) => ("at_most", *share),
                    _ => {
                        let reason = "expected either at_least or at_most, a share of the robots";
                        return Err(wrong("", reason));
                    }
                };
                if !(0.0..=1.0).contains(&share) {
                    return Err(wrong(field, format!("{share} found, expected 0 to 1")));
                }
            }
            Self::ChainReach { from, to, link, .. } => {
                length("link", *link)?;
                has_middle(layout, "from", from)?;
                has_middle(layout, "to", to)?;
                if from == to {
                    return Err(wrong("to", "from and to must be different patches"));
                }
            }
            _ => {}
        }
        Ok(())
    }

    /// Returns the patches that the metric refers to, with the fields that name them.
    fn patches(&self) -> Vec<(String, &str)> {
        match self {
            Self::RobotsOn { patch, .. }
            | Self::ObjectsOn { patch, .. }
            | Self::ObjectDistance { patch, .. }
            | Self::TimeUntil { patch, .. }
            | Self::CrossingsSouth { patch }
            | Self::RobotsInWrongHalf { patch }
            | Self::StopErrors { patch }
            | Self::MeanDistanceInside { patch, .. }
            | Self::MeanDistanceRim { patch, .. } => vec![one("patch", patch)],
            Self::MostRobotsOn { patches, .. } => several("patches", patches),
            Self::MeanDistance { outside, .. } => several("outside", outside),
            Self::Returns { sources, nest } => {
                let mut all = several("sources", sources);
                all.push(one("nest", nest));
                all
            }
            Self::ChainReach { from, to, .. } => vec![one("from", from), one("to", to)],
            Self::LargestGroupArea { .. }
            | Self::ObjectsHeld { .. }
            | Self::Caught { .. }
            | Self::FlagsBrought { .. }
            | Self::FlagsCarried { .. }
            | Self::PaintedShare { .. }
            | Self::Sum { .. }
            | Self::CellAge { .. }
            | Self::Order { .. }
            | Self::Speed { .. }
            | Self::GroupSpeed { .. }
            | Self::DistanceToCenter { .. }
            | Self::NearestDistance { .. }
            | Self::LargestGroup { .. }
            | Self::Groups { .. }
            | Self::CoveredShare { .. }
            | Self::VisitedShare { .. }
            | Self::ShapeDeviation { .. } => Vec::new(),
        }
    }

    /// Checks that the objects to which the metric refers exist.
    fn check_object(&self, layout: &Place) -> Result<(), ParameterError> {
        let (Self::ObjectsOn { object, .. }
        | Self::ObjectDistance { object, .. }
        | Self::ObjectsHeld { object, .. }) = self
        else {
            return Ok(());
        };
        if layout.objects.is_empty() {
            return Err(wrong("", "the mission has no objects"));
        }
        let names = || layout.objects.iter().map(|kind| kind.name.as_str());
        match object {
            Some(object) if !names().any(|name| name == object) => {
                let listing = listed(names());
                let reason = format!("no object is named {object:?}; available: {listing}");
                Err(wrong("object", reason))
            }
            _ => Ok(()),
        }
    }
}

fn listed<'a>(names: impl Iterator<Item = &'a str>) -> String {
    let names: Vec<_> = names.collect();
    if names.is_empty() {
        "none".to_owned()
    } else {
        names.join(", ")
    }
}

fn has_middle(layout: &Place, field: &str, name: &str) -> Result<(), ParameterError> {
    let middle = layout.patch(name).map(|patch| patch.shape.middle());
    if middle.is_some_and(|middle| middle.iter().any(|number| !number.is_finite())) {
        let reason = format!("{name} has no middle, since it is unbounded");
        return Err(wrong(field, reason));
    }
    Ok(())
}

/// Pair a name, or each name of a list, with its field.
fn one<'a>(field: &str, name: &'a str) -> (String, &'a str) {
    (field.to_owned(), name)
}

fn several<'a>(field: &str, names: &'a [String]) -> Vec<(String, &'a str)> {
    let each = names.iter().enumerate();
    each.map(|(index, name)| (format!("{field}[{index}]"), name.as_str()))
        .collect()
}

/// Checks that a number is a valid length.
fn length(field: &str, number: f32) -> Result<(), ParameterError> {
    if number > 0.0 && number <= LONGEST {
        return Ok(());
    }
    let reason = format!("{number} found, expected a number above 0, at most {LONGEST}");
    Err(wrong(field, reason))
}

impl Formation {
    fn check(&self) -> Result<(), ParameterError> {
        let check_points = |field: &str, points: &[[f32; 2]]| {
            let mut numbers = points.as_flattened().iter();
            match numbers.find(|number| number.is_nan() || number.abs() > LONGEST) {
                Some(number) => Err(wrong(
                    &format!("shape.{field}"),
                    format!("{number} found, expected numbers from -{LONGEST} to {LONGEST}"),
                )),
                None => Ok(()),
            }
        };
        match (self.circle, &self.polygon, self.line, &self.points) {
            (Some(radius), None, None, None) => length("shape.circle", radius),
            (None, Some(corners), None, None) => {
                check_points("polygon", corners)?;
                let tidy = polygon::tidy(corners);
                tidy.map_err(|reason| wrong("shape.polygon", reason))?;
                Ok(())
            }
            (None, None, Some(ends), None) => check_points("line", &ends),
            (None, None, None, Some(points)) if (1..=MOST_POINTS).contains(&points.len()) => {
                check_points("points", points)
            }
            _ => Err(wrong(
                "shape",
                format!("expected circle, or polygon, or line, or 1 to {MOST_POINTS} points"),
            )),
        }
    }
}
