//! Units and descriptions of metrics.

use super::kind::{Metric, When};

impl Metric {
    pub fn unit(&self) -> &'static str {
        match self {
            Self::RobotsOn { share: true, .. }
            | Self::ObjectsOn { share: true, .. }
            | Self::ObjectsHeld { share: true, .. }
            | Self::Caught { share: true, .. }
            | Self::PaintedShare { .. }
            | Self::Sum { .. }
            | Self::MostRobotsOn { share: true, .. } => "",
            Self::ObjectsOn { .. } | Self::ObjectsHeld { .. } => "objects",
            Self::RobotsOn { .. }
            | Self::MostRobotsOn { .. }
            | Self::Caught { .. }
            | Self::RobotsInWrongHalf { .. } => "robots",
            Self::LargestGroup { share: false, .. } => "robots",
            Self::Order { .. }
            | Self::LargestGroup { share: true, .. }
            | Self::CoveredShare { .. }
            | Self::VisitedShare { .. }
            | Self::ChainReach { .. } => "",
            Self::Groups { .. } => "groups",
            Self::FlagsBrought { .. } | Self::FlagsCarried { .. } => "flags",
            Self::Speed { .. } | Self::GroupSpeed { .. } => "m/s",
            Self::Returns { .. } => "returns",
            Self::CrossingsSouth { .. } => "crossings",
            Self::StopErrors { .. } | Self::CellAge { .. } => "ticks",
            Self::TimeUntil { .. } => "s",
            Self::LargestGroupArea { .. } => "m^2",
            Self::MeanDistance { .. }
            | Self::ObjectDistance { .. }
            | Self::DistanceToCenter { .. }
            | Self::NearestDistance { .. }
            | Self::ShapeDeviation { .. }
            | Self::MeanDistanceInside { .. }
            | Self::MeanDistanceRim { .. } => "m",
        }
    }

    pub fn description(&self) -> String {
        let when = |when: &When| match when {
            When::EachTick => "summed over the ticks".to_owned(),
            When::Mean => "as a mean over the ticks".to_owned(),
            When::End => "at the end".to_owned(),
            When::At(seconds) => format!("after {seconds} s"),
        };
        match self {
            Self::RobotsOn {
                patch,
                robots,
                share,
                when: at,
            } => {
                let whom = whom(robots.as_deref(), *share);
                format!("{whom} on {patch}, {}.", when(at))
            }
            Self::Caught {
                robots,
                share,
                when: at,
            } => {
                let whom = whom(robots.as_deref(), *share);
                format!("{whom} that are caught, {}.", when(at))
            }
            Self::FlagsBrought { flag } => {
                let flags = flag.as_deref().unwrap_or("flags");
                format!("How often robots brought {flags} home.")
            }
            Self::FlagsCarried { flag, when: at } => {
                let flags = flag.as_deref().unwrap_or("flags");
                format!("{flags} that robots carry, {}.", when(at))
            }
            Self::PaintedShare {
                robots,
                cell,
                when: at,
            } => format!(
                "Share of the squares of {cell} m that {robots} were in last, {}.",
                when(at)
            ),
            Self::Sum { offset, factors } => {
                let number = (*offset != 0.0 || factors.is_empty()).then(|| offset.to_string());
                let parts = factors.iter().map(|(name, factor)| match *factor {
                    1.0 => name.clone(),
                    factor => format!("{factor} {name}"),
                });
                let parts: Vec<_> = number.into_iter().chain(parts).collect();
                format!("{}.", parts.join(" + ").replace("+ -", "- "))
            }
            Self::MostRobotsOn {
                patches,
                share,
                when: at,
            } => format!(
                "{} on that of {} with most of them, {}.",
                if *share {
                    "Share of the robots"
                } else {
                    "Robots"
                },
                patches.join(", "),
                when(at)
            ),
            Self::ObjectsOn {
                patch,
                object,
                share,
                when: at,
            } => format!(
                "{} on {patch}, {}.",
                objects(object.as_deref(), *share),
                when(at)
            ),
            Self::ObjectsHeld {
                object,
                share,
                when: at,
            } => format!(
                "{} that robots hold, {}.",
                objects(object.as_deref(), *share),
                when(at)
            ),
            Self::ObjectDistance {
                patch,
                object,
                when: at,
            } => format!(
                "Mean distance of {} from the middle of {patch}, {}.",
                object.as_deref().unwrap_or("objects"),
                when(at)
            ),
            Self::Returns { sources, nest } => {
                format!("Returns from {} to {nest}.", sources.join(" or "))
            }
            Self::TimeUntil {
                patch,
                at_least,
                at_most,
            } => {
                let (bound, share) = match at_most {
                    Some(share) => ("at most", *share),
                    None => ("at least", at_least.unwrap_or_default()),
                };
                format!("Seconds until {bound} {share} of the robots were on {patch}.")
            }
            Self::CrossingsSouth { patch } => {
                format!("Crossings of the middle of {patch} southward, minus northward.")
            }
            Self::RobotsInWrongHalf { patch } => format!(
                "Robots in the half where they should not be, by the colour of {patch}, summed over the ticks."
            ),
            Self::StopErrors { patch } => format!(
                "Ticks of robots until one was on {patch}, and of those that stood before or moved after that."
            ),
            Self::LargestGroupArea { .. } => {
                "Area that the largest connected group covers at the end.".to_owned()
            }
            Self::MeanDistance { .. } => {
                "Mean distance from points of the arena to the nearest robot at the end.".to_owned()
            }
            Self::MeanDistanceInside { patch, .. } => {
                format!(
                    "Mean distance from points of {patch} to the nearest robot on it at the end."
                )
            }
            Self::MeanDistanceRim { patch, .. } => format!(
                "Mean distance from points of the rim of {patch} to the nearest robot near it at the end."
            ),
            Self::CellAge { .. } => {
                "Mean ticks since the cells were visited, summed over the ticks.".to_owned()
            }
            Self::Order { when: at } => {
                format!("Length of the mean heading as a unit vector, {}.", when(at))
            }
            Self::Speed { when: at } => format!("Mean speed of the robots, {}.", when(at)),
            Self::GroupSpeed { link, when: at } => format!(
                "Length of the mean velocity{}, {}.",
                link.map_or(
                    "",
                    |_| " of the largest group, times its share of the robots"
                ),
                when(at)
            ),
            Self::DistanceToCenter { when: at } => {
                format!(
                    "Mean distance of the robots from their center, {}.",
                    when(at)
                )
            }
            Self::NearestDistance { when: at } => {
                format!("Mean distance to the nearest robot, {}.", when(at))
            }
            Self::LargestGroup {
                link,
                share,
                when: at,
            } => format!(
                "{} in the largest group, linked by less than {link} m, {}.",
                if *share {
                    "Share of the robots"
                } else {
                    "Robots"
                },
                when(at)
            ),
            Self::Groups { link, when: at } => {
                format!(
                    "Groups of robots, linked by less than {link} m, {}.",
                    when(at)
                )
            }
            Self::CoveredShare { radius, when: at } => {
                format!(
                    "Share of the floor at most {radius} m from a robot, {}.",
                    when(at)
                )
            }
            Self::VisitedShare { cell } => {
                format!("Share of the squares of {cell} m that robots have been in.")
            }
            Self::ShapeDeviation { when: at, .. } => {
                format!(
                    "Mean distance of the robots from the formation and back, {}.",
                    when(at)
                )
            }
            Self::ChainReach {
                from, to, when: at, ..
            } => format!(
                "How far a chain of robots reaches from {from} to {to}, 0 to 1, {}.",
                when(at)
            ),
        }
    }
}

/// Returns the beginning of a description of robots.
fn whom(kind: Option<&str>, share: bool) -> String {
    match (kind, share) {
        (Some(kind), true) => format!("Share of {kind}"),
        (Some(kind), false) => kind.to_owned(),
        (None, true) => "Share of the robots".to_owned(),
        (None, false) => "Robots".to_owned(),
    }
}

/// Returns the beginning of a description of objects.
fn objects(name: Option<&str>, share: bool) -> String {
    match (name, share) {
        (Some(name), true) => format!("Share of {name}"),
        (Some(name), false) => name.to_owned(),
        (None, true) => "Share of the objects".to_owned(),
        (None, false) => "Objects".to_owned(),
    }
}
