//! Which shells are to go to which, as the user says: checked, and joined by the shells around them.

use std::collections::BTreeMap;
use std::fmt::{self, Display, Formatter};

use super::{Shell, Solid};

/// Why shells cannot go where they are to go ([`PairOptions::components`](super::super::PairOptions::components)). Shells are components
/// and cavities, and count from 0 in the order of their first triangles.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ComponentsError {
    /// A shell that does not exist.
    #[error(
        "there is no shell {shell} in the {side}: it has {shells} (components and cavities), counted from 0; `solidmap check` lists them"
    )]
    OutOfRange {
        /// `"domain"` or `"target"`.
        side: &'static str,
        /// The shell.
        shell: usize,
        /// How many there are.
        shells: usize,
    },
    /// A shell in two pairs.
    #[error(
        "shell {shell} of the {side} is given twice, with shells {} and {} of the {}; leave one of them out", others[0], others[1],
        if *side == "domain" { "target" } else { "domain" }
    )]
    Duplicate {
        /// `"domain"` or `"target"`.
        side: &'static str,
        /// The shell.
        shell: usize,
        /// Those of the other solid that it is given with.
        others: [usize; 2],
    },
    /// Two shells that no boundary map of the solids takes to each other.
    #[error(
        "shell {} of the domain cannot go to shell {} of the target{}: {mismatch}; `solidmap check` lists the shells of a solid",
        shells[0], shells[1], reason_of(*shells, *given)
    )]
    Mismatch {
        /// The shell of the domain and that of the target: those of `given`, or shells around them.
        shells: [usize; 2],
        /// The shells that are to go to each other.
        given: [usize; 2],
        /// Why they cannot.
        mismatch: ComponentMismatch,
    },
}

fn reason_of(shells: [usize; 2], [from, to]: [usize; 2]) -> String {
    match shells == [from, to] {
        true => String::new(),
        false => format!(", as those inside them are to, {from} to {to}"),
    }
}

/// In what two shells differ.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum ComponentMismatch {
    /// One bounds a solid, and the other a cavity.
    Kind {
        /// Whether the domain's is the cavity.
        is_cavity: bool,
    },
    /// They have different numbers of handles.
    Genus {
        /// Handles of the domain's shell.
        domain: u64,
        /// Handles of the target's shell.
        target: u64,
    },
    /// They hold different shells: not as many, or with other handles, or with other shells in them.
    Inside {
        /// The shells right inside the domain's.
        domain: Vec<usize>,
        /// Those right inside the target's.
        target: Vec<usize>,
    },
    /// They lie in shells that do not go to each other, or one lies in none.
    Around {
        /// The shell around the domain's.
        domain: Option<usize>,
        /// That around the target's.
        target: Option<usize>,
    },
    /// Landmarks or curves on one of them are on another shell of the other solid.
    Landmarks,
}

impl Display for ComponentMismatch {
    fn fmt(&self, f: &mut Formatter) -> fmt::Result {
        match self {
            Self::Kind { is_cavity: true } => write!(f, "the first bounds a cavity, and the second a solid"),
            Self::Kind { is_cavity: false } => write!(f, "the first bounds a solid, and the second a cavity"),
            Self::Genus { domain, target } => {
                write!(
                    f,
                    "the first has genus {domain} (handles), and the second genus {target}"
                )
            }
            Self::Inside { domain, target } => {
                let [domain, target] = [domain, target].map(|inside| listed(inside));
                write!(
                    f,
                    "what lies in them does not match: {domain} in the first, {target} in the second"
                )
            }
            Self::Around { domain, target } => {
                let place = |around: &Option<usize>| around.map_or("no shell".into(), |k| format!("shell {k}"));
                let (domain, target) = (place(domain), place(target));
                write!(
                    f,
                    "the first lies in {domain}, and the second in {target}, which do not go to each other"
                )
            }
            Self::Landmarks => write!(f, "landmarks or curves take one of them to another shell"),
        }
    }
}

fn listed(shells: &[usize]) -> String {
    let numbers: Vec<String> = shells.iter().map(ToString::to_string).collect();
    match shells.len() {
        0 => "no shell".into(),
        1 => format!("shell {}", numbers[0]),
        _ => format!("shells {}", numbers.join(", ")),
    }
}

/// Checks pairs of shells for solids with so many of them.
///
/// # Errors
///
/// When there is no such shell, or it is in two pairs.
pub fn require_pairs(pairs: &[[usize; 2]], counts: [usize; 2]) -> Result<(), ComponentsError> {
    for (at, side) in ["domain", "target"].into_iter().enumerate() {
        let mut others = BTreeMap::new();
        for pair in pairs {
            let (shell, other, shells) = (pair[at], pair[1 - at], counts[at]);
            if shell >= shells {
                return Err(ComponentsError::OutOfRange { side, shell, shells });
            }
            if let Some(first) = others.insert(shell, other) {
                let others = [first, other];
                return Err(ComponentsError::Duplicate { side, shell, others });
            }
        }
    }
    Ok(())
}

/// For every shell of the domain that is in a pair, or lies around one that is, the target's shell that it goes to.
///
/// # Errors
///
/// When no boundary map takes all the pairs to each other, or `by_landmarks`, which are such pairs, too, says otherwise.
pub(super) fn partners(
    solids: &[Solid; 2],
    pairs: &[[usize; 2]],
    by_landmarks: &BTreeMap<usize, usize>,
) -> Result<BTreeMap<usize, usize>, ComponentsError> {
    require_pairs(pairs, [0, 1].map(|side| solids[side].shells.len()))?;
    let mut partners: BTreeMap<usize, usize> = pairs.iter().map(|&[from, to]| (from, to)).collect();
    for &given in pairs {
        let mut next = Some(given);
        while let Some(shells) = next {
            let [a, b] = [0, 1].map(|side| &solids[side].shells[shells[side]]);
            let mismatch = match (difference(a, b), a.around, b.around) {
                (Some(found), ..) => Some(found),
                _ if contradicts(by_landmarks, shells) => Some(ComponentMismatch::Landmarks),
                (_, None, None) => None,
                (_, Some(from), Some(to)) if !contradicts(&partners, [from, to]) => None,
                (_, domain, target) => Some(ComponentMismatch::Around { domain, target }),
            };
            if let Some(mismatch) = mismatch {
                return Err(ComponentsError::Mismatch {
                    shells,
                    given,
                    mismatch,
                });
            }
            next = a.around.zip(b.around).map(<[usize; 2]>::from);
            partners.extend(next.map(<(usize, usize)>::from));
        }
    }
    Ok(partners)
}

/// Why no boundary map takes a shell with what lies in it to another.
fn difference(a: &Shell, b: &Shell) -> Option<ComponentMismatch> {
    if a.is_cavity != b.is_cavity {
        let is_cavity = a.is_cavity;
        Some(ComponentMismatch::Kind { is_cavity })
    } else if a.genus != b.genus {
        let (domain, target) = (a.genus, b.genus);
        Some(ComponentMismatch::Genus { domain, target })
    } else if a.signature != b.signature {
        let [domain, target] = [&a.inside, &b.inside].map(Clone::clone);
        Some(ComponentMismatch::Inside { domain, target })
    } else {
        None
    }
}

/// Whether one of the two goes to, or comes from, another one.
fn contradicts(partners: &BTreeMap<usize, usize>, [from, to]: [usize; 2]) -> bool {
    partners.iter().any(|(&shell, &other)| (shell == from) != (other == to))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{SurfaceMesh, shapes};
    use crate::{Point, Vector};

    fn ball(x: f64, radius: f64) -> SurfaceMesh {
        shapes::deformed(&shapes::sphere(radius, 1), |p| p + x * Vector::x())
    }

    /// Two solids: one with a cavity that has a ball in it, one with two cavities; and a ring.
    fn solid(offset: f64) -> Solid {
        let ring = shapes::deformed(&shapes::torus(1.0, 0.3, 12, 8), |p| {
            Point::new(p.x + offset + 9.0, p.y, p.z)
        });
        let shells = [
            ball(offset, 1.0),
            ball(offset, 0.6).reversed(),
            ball(offset, 0.2),
            ball(offset + 4.0, 1.0),
            ball(offset + 3.6, 0.2).reversed(),
            ball(offset + 4.4, 0.2).reversed(),
            ring,
            ball(offset + 13.0, 1.0),
            ball(offset + 13.0, 0.2).reversed(),
        ];
        let whole = shells[1..].iter().fold(shells[0].clone(), |a, b| shapes::joined(&a, b));
        Solid::of("domain", &whole).unwrap()
    }

    fn found(pairs: &[[usize; 2]]) -> Result<Vec<[usize; 2]>, ComponentsError> {
        let solids = [solid(0.0), solid(100.0)];
        let partners = partners(&solids, pairs, &BTreeMap::new())?;
        Ok(partners.into_iter().map(<[usize; 2]>::from).collect())
    }

    #[test]
    fn shells_around_those_given_go_to_each_other() {
        assert_eq!(found(&[]).unwrap(), [[0; 2]; 0]);
        assert_eq!(found(&[[2, 2]]).unwrap(), [[0, 0], [1, 1], [2, 2]]);
        assert_eq!(found(&[[4, 5], [3, 3]]).unwrap(), [[3, 3], [4, 5]]);
        assert_eq!(found(&[[6, 6], [8, 8]]).unwrap(), [[6, 6], [7, 7], [8, 8]]);
    }

    #[test]
    fn what_contradicts_the_solids_or_itself_is_refused_by_name() {
        let of = |pairs: &[[usize; 2]]| found(pairs).unwrap_err();
        let (side, shells) = ("target", 9);
        assert_eq!(of(&[[0, 9]]), ComponentsError::OutOfRange { side, shell: 9, shells });
        let others = [4, 5];
        let twice = ComponentsError::Duplicate {
            side: "domain",
            shell: 4,
            others,
        };
        assert_eq!(of(&[[4, 4], [4, 5]]), twice);
        let shell = 5;
        assert_eq!(
            of(&[[4, 5], [5, 5]]),
            ComponentsError::Duplicate { side, shell, others }
        );
        let mismatch = |pairs: &[[usize; 2]]| match of(pairs) {
            ComponentsError::Mismatch {
                shells,
                given,
                mismatch,
            } => (shells, given, mismatch),
            other => panic!("{other}"),
        };
        let kind = ComponentMismatch::Kind { is_cavity: true };
        assert_eq!(mismatch(&[[1, 0]]), ([1, 0], [1, 0], kind));
        let (domain, target) = (0, 1);
        assert_eq!(mismatch(&[[0, 6]]).2, ComponentMismatch::Genus { domain, target });
        let [domain, target] = [vec![1], vec![4, 5]];
        assert_eq!(mismatch(&[[0, 3]]).2, ComponentMismatch::Inside { domain, target });
        // Both are balls with nothing in them.
        let [domain, target] = [Some(3), Some(7)];
        assert_eq!(
            mismatch(&[[3, 3], [4, 8]]),
            ([4, 8], [4, 8], ComponentMismatch::Around { domain, target })
        );
        // The solids around these cavities differ.
        let [domain, target] = [vec![4, 5], vec![8]];
        let inside = ComponentMismatch::Inside { domain, target };
        assert_eq!(mismatch(&[[4, 8]]), ([3, 7], [4, 8], inside));
        let words = of(&[[4, 8]]).to_string();
        assert!(
            words.contains(
                "shell 3 of the domain cannot go to shell 7 of the target, as those inside them are to, 4 to 8"
            ),
            "{words}"
        );
        assert!(
            words.contains("shells 4, 5 in the first, shell 8 in the second"),
            "{words}"
        );
    }

    #[test]
    fn an_island_does_not_go_to_an_outer_solid() {
        let parts = [
            ball(0.0, 1.0),
            ball(0.0, 0.6).reversed(),
            ball(0.0, 0.2),
            ball(3.0, 0.2),
        ];
        let whole = parts[1..].iter().fold(parts[0].clone(), |a, b| shapes::joined(&a, b));
        let solids = [(); 2].map(|()| Solid::of("domain", &whole).unwrap());
        let error = partners(&solids, &[[2, 3]], &BTreeMap::new()).unwrap_err();
        assert!(
            error
                .to_string()
                .contains("the first lies in shell 1, and the second in no shell"),
            "{error}"
        );
        let by_landmarks = BTreeMap::from([(0, 0), (1, 1), (2, 2)]);
        assert_eq!(
            partners(&solids, &[[3, 3]], &by_landmarks).unwrap(),
            BTreeMap::from([(3, 3)])
        );
        let swapped = partners(&solids, &[[3, 2]], &by_landmarks).unwrap_err();
        assert!(swapped.to_string().contains("landmarks or curves"), "{swapped}");
    }
}
