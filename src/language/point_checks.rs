//! Checks between points and devices: local points do not overlap, a point that others show stays, and values fit the memory.
//! Also deletes devices and points.

use super::changed::Changed;
use super::point_problem::PointProblem;
use super::problem::Problem;
use super::words::{Word, Wrong};
use crate::scanner::{Kind, VALUE_BYTES_MAX};
use crate::settings::{PointAt, PointSettings, Settings};

pub(crate) fn existing_point<'s>(
    settings: &'s Settings,
    word: Word,
) -> Result<(u8, &'s PointSettings), Wrong> {
    let index = settings.find_point(word.text);
    let found = index.and_then(|index| Some((index, settings.points.get(usize::from(index))?)));
    found.ok_or_else(|| word.error(Problem::Points(PointProblem::NoSuchPoint)))
}

/// Checks `point` against the others; `index` is its index, if it exists already.
pub(crate) fn check_others(
    settings: &Settings,
    point: &PointSettings,
    index: Option<usize>,
    name: Word,
    address: Word,
) -> Result<(), Wrong> {
    let index = index.unwrap_or(settings.points.len());
    let others = || settings.points.iter().enumerate().filter(|&(at, _)| at != index).map(|(_, other)| other);
    let shows = |other: &PointSettings| matches!(other.at, PointAt::Local { of: Some(of), .. } if usize::from(of) == index);
    let is_same =
        |old: &PointSettings| (old.count, old.value, old.scale) == (point.count, point.value, point.scale);
    if let PointAt::Local { of: Some(of), .. } = point.at
        && usize::from(of) >= index
    {
        return Err(name.error(Problem::Points(PointProblem::ShowsLater)));
    }
    let changes = settings.points.get(index).is_some_and(|old| !is_same(old));
    let becomes_other = matches!(point.at, PointAt::Local { of: Some(_), .. });
    if others().any(shows) && (changes || becomes_other) {
        return Err(name.error(Problem::Points(PointProblem::PointShown)));
    }
    if others().any(|other| spans(other).any(|theirs| spans(point).any(|own| meet(own, theirs))))
        || meets_itself(point)
    {
        return Err(address.error(Problem::Points(PointProblem::AddressTaken)));
    }
    let bytes = others().map(PointSettings::bytes).sum::<usize>() + point.bytes();
    if bytes > VALUE_BYTES_MAX {
        return Err(address.error(Problem::Points(PointProblem::ValuesFull)));
    }
    Ok(())
}

type Span = (Kind, u32, u32);

/// The cells that a point occupies in the gateway's own unit.
fn spans(point: &PointSettings) -> impl Iterator<Item = Span> {
    let (own, quality) = match point.at {
        PointAt::Device { .. } => (None, None),
        PointAt::Local { quality, .. } => {
            let end = u32::from(point.first) + u32::from(point.cells());
            let quality = quality.map(|first| (Kind::Input, first.into(), u32::from(first) + 2));
            (Some((point.kind, point.first.into(), end)), quality)
        }
    };
    own.into_iter().chain(quality)
}

fn meets_itself(point: &PointSettings) -> bool {
    let mut spans = spans(point);
    matches!((spans.next(), spans.next()), (Some(own), Some(quality)) if meet(own, quality))
}

fn meet(one: Span, other: Span) -> bool {
    one.0 == other.0 && one.1 < other.2 && other.1 < one.2
}

/// Deletes the device that `word` names.
pub(crate) fn delete_device(settings: &mut Settings, word: Word) -> Result<Changed, Wrong> {
    let missing = || word.error(Problem::Points(PointProblem::NoSuchDevice));
    let gone = settings.find_device(word.text).ok_or_else(missing)?;
    for point in &mut settings.points {
        let PointAt::Device { device, .. } = &point.at else { continue };
        if *device == gone {
            return Err(word.error(Problem::Points(PointProblem::DeviceInUse)));
        }
    }
    for point in &mut settings.points {
        if let PointAt::Device { device, .. } = &mut point.at
            && *device > gone
        {
            *device -= 1;
        }
    }
    settings.devices.remove(gone.into());
    Ok(Changed::Other)
}

/// See [`delete_device`].
pub(crate) fn delete_point(settings: &mut Settings, word: Word) -> Result<Changed, Wrong> {
    let (gone, _) = existing_point(settings, word)?;
    let shows = |point: &PointSettings| matches!(point.at, PointAt::Local { of: Some(of), .. } if of == gone);
    if settings.points.iter().any(shows) {
        return Err(word.error(Problem::Points(PointProblem::PointShown)));
    }
    settings.points.remove(gone.into());
    for point in &mut settings.points {
        if let PointAt::Local { of: Some(of), .. } = &mut point.at
            && *of > gone
        {
            *of -= 1;
        }
    }
    Ok(Changed::Other)
}
