//! A device's faults as sentences: first which requests, then what happens to their responses.

use embassy_time::Instant;
use mobgate_simulator::wire::Flaw;
use mobgate_simulator::{Fault, Faults, fault::When};

use crate::words::{duration, number};

/// `sentences` as faults; what is left to chance comes from `seed`.
pub(crate) fn faults<S: AsRef<str>>(seed: u64, sentences: &[S]) -> Result<Faults, String> {
    sentences.iter().try_fold(Faults::new(seed), |faults, sentence| {
        let words: Vec<&str> = sentence.as_ref().split_whitespace().collect();
        let (when, fault) = when(&words)?;
        Ok(faults.with(when, self::fault(fault)?))
    })
}

fn when<'w, 's>(words: &'w [&'s str]) -> Result<(When, &'w [&'s str]), String> {
    let since_start = |word| duration(word).map(|time| Instant::from_ticks(0) + time);
    Ok(match words {
        ["always", rest @ ..] => (When::Always, rest),
        ["every", nth, rest @ ..] => {
            let nth = nth.trim_end_matches(|letter: char| letter.is_ascii_alphabetic());
            (When::Every(number(nth)?), rest)
        }
        ["chance", probability, rest @ ..] => (When::Chance(number(probability)?), rest),
        ["request", which, rest @ ..] => (When::Requests(number(which)?..=number(which)?), rest),
        ["requests", first, "to", last, rest @ ..] => (When::Requests(number(first)?..=number(last)?), rest),
        ["from", start, "to", end, rest @ ..] => {
            (When::During(since_start(start)?..=since_start(end)?), rest)
        }
        ["function", function, rest @ ..] => (When::Function(number(function)?), rest),
        _ => {
            return Err(format!(
                "{:?} does not begin with always, every, chance, request, requests, from or function",
                words.join(" ")
            ));
        }
    })
}

fn fault(words: &[&str]) -> Result<Fault, String> {
    Ok(match words {
        ["dead"] => Fault::Dead,
        ["unheard"] => Fault::Unheard,
        ["hiccup", length] => Fault::Hiccup(duration(length)?, duration(length)?),
        ["hiccup", least, "to", most] => Fault::Hiccup(duration(least)?, duration(most)?),
        ["late", by] => Fault::Late(duration(by)?, duration(by)?),
        ["late", least, "to", most] => Fault::Late(duration(least)?, duration(most)?),
        ["late", "about", mean] => Fault::Lingers(duration(mean)?),
        ["bad", "crc"] => Fault::BadCrc,
        ["flipped", "bit"] => Fault::FlippedBit,
        ["lost", "byte"] => Fault::LostByte,
        ["truncated"] => Fault::Truncated,
        ["truncated", "to", length] => Fault::CutTo(number(length)?),
        ["bad", "parity"] => Fault::Flawed(Flaw::Parity),
        ["no", "stop", "bit"] => Fault::Flawed(Flaw::Framing),
        ["wrong", "unit"] => Fault::WrongUnit,
        ["wrong", "function"] => Fault::WrongFunction,
        ["wrong", "length"] => Fault::WrongLength,
        ["wrong", "echo"] => Fault::WrongEcho,
        ["wrong", "transaction"] => Fault::WrongTransaction,
        ["close"] => Fault::Close,
        ["reset"] => Fault::Reset,
        ["noise", "before", count] => Fault::NoiseBefore(number(count)?),
        ["noise", "after", count] => Fault::NoiseAfter(number(count)?),
        ["gap", "inside", gap] => Fault::GapInside(duration(gap)?),
        ["exception", code] => {
            Fault::Exception(u8::from_str_radix(code, 16).map_err(|error| error.to_string())?)
        }
        ["twice", "after", pause] => Fault::Twice(duration(pause)?),
        _ => return Err(format!("{:?} is no fault", words.join(" "))),
    })
}
