//! Tables of keywords, their keywords as listed in errors ("port, route or mdns"), and texts of several parts. Made at build time.

/// A table of keywords with the values that they stand for, and how those are printed.
macro_rules! keywords {
    ($visibility:vis $TABLE:ident: $type:ident { $($word:literal: $value:ident),+ }) => {
        $visibility const $TABLE: &[(&str, $type)] = &[$(($word, $type::$value)),+];

        impl core::fmt::Display for $type {
            fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
                f.pad(match self { $(Self::$value => $word),+ })
            }
        }
    };
}
pub(crate) use keywords;

/// The text for a table of keywords with their values.
macro_rules! listed {
    ($table:expr) => {{
        const BYTES: [u8; $crate::language::listed::bytes($table)] = $crate::language::listed::list($table);
        match core::str::from_utf8(&BYTES) {
            Ok(text) => text,
            Err(_) => "",
        }
    }};
}
pub(crate) use listed;

/// The text of these parts, of which an image may lack some.
macro_rules! joined {
    ($parts:expr) => {{
        const BYTES: [u8; $crate::language::listed::joined_bytes($parts)] =
            $crate::language::listed::join($parts);
        match core::str::from_utf8(&BYTES) {
            Ok(text) => text,
            Err(_) => "",
        }
    }};
}
pub(crate) use joined;

/// The separator between two keywords, with `rest` keywords left.
const fn between(rest: usize) -> &'static [u8] {
    if rest == 1 { b" or " } else { b", " }
}

/// The length of the text.
pub(crate) const fn bytes<T>(mut table: &[(&str, T)]) -> usize {
    let mut count = 0;
    while let [(word, _), rest @ ..] = table {
        count += word.len();
        if !rest.is_empty() {
            count += between(rest.len()).len();
        }
        table = rest;
    }
    count
}

/// The text, which has `N` bytes.
pub(crate) const fn list<const N: usize, T>(mut table: &[(&str, T)]) -> [u8; N] {
    let mut text = [0; N];
    let mut left: &mut [u8] = &mut text;
    while let [(word, _), rest @ ..] = table {
        left = copy(word.as_bytes(), left);
        if !rest.is_empty() {
            left = copy(between(rest.len()), left);
        }
        table = rest;
    }
    text
}

/// The length of the parts together.
pub(crate) const fn joined_bytes(mut parts: &[&str]) -> usize {
    let mut count = 0;
    while let [part, rest @ ..] = parts {
        count += part.len();
        parts = rest;
    }
    count
}

/// The parts together, which have `N` bytes.
pub(crate) const fn join<const N: usize>(mut parts: &[&str]) -> [u8; N] {
    let mut text = [0; N];
    let mut left: &mut [u8] = &mut text;
    while let [part, rest @ ..] = parts {
        left = copy(part.as_bytes(), left);
        parts = rest;
    }
    text
}

/// Copies `from` to the start of `into`; returns the rest of `into`.
const fn copy<'i>(from: &[u8], into: &'i mut [u8]) -> &'i mut [u8] {
    let Some((place, rest)) = into.split_at_mut_checked(from.len()) else { return &mut [] };
    place.copy_from_slice(from);
    rest
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_last_word_stands_behind_an_or() {
        assert_eq!(listed!(&[("port", 1), ("route", 2), ("mdns", 3)]), "port, route or mdns");
        assert_eq!(listed!(&[("on", true), ("off", false)]), "on or off");
        assert_eq!(listed!(&[("route", ())]), "route");
    }

    #[test]
    fn parts_are_joined_in_their_order() {
        assert_eq!(joined!(&["port NAME\n", "", "route"]), "port NAME\nroute");
    }
}
