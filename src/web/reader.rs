//! Reads JSON (RFC 8259) value by value, without a heap: the caller says what is expected, and where it goes.

use core::fmt::Write;

use heapless::String;

use super::untaken::Untaken;

/// Fits the names of all members.
const NAME_BYTES_MAX: usize = 24;

/// The rest of a text.
pub(super) struct Reader<'b> {
    text: &'b str,
    rest: &'b str,
}

/// Reads a part of a value.
type Part<'p, 'b> = &'p mut dyn FnMut(&mut Reader<'b>) -> Result<(), Untaken>;

impl<'b> Reader<'b> {
    pub(super) fn new(text: &'b str) -> Self {
        Self { text, rest: text }
    }

    /// The error at this place.
    pub(super) fn expected(&self, what: &'static str) -> Untaken {
        Untaken::Expected(what, self.text.len() - self.rest.len() + 1)
    }

    /// Takes this token, behind blanks, if it is next.
    pub(super) fn takes(&mut self, token: &str) -> bool {
        self.rest = self.rest.trim_start_matches([' ', '\t', '\n', '\r']);
        let rest = self.rest.strip_prefix(token);
        self.rest = rest.unwrap_or(self.rest);
        rest.is_some()
    }

    fn expect(&mut self, token: &str, what: &'static str) -> Result<(), Untaken> {
        if self.takes(token) { Ok(()) } else { Err(self.expected(what)) }
    }

    fn char(&mut self) -> Option<char> {
        let mut chars = self.rest.chars();
        let char = chars.next();
        self.rest = chars.as_str();
        char
    }

    /// Ends the text.
    pub(super) fn end(&mut self) -> Result<(), Untaken> {
        self.takes("");
        if self.rest.is_empty() { Ok(()) } else { Err(self.expected("nothing behind the object")) }
    }

    /// Reads an object; `member` reads the value of a member by its name.
    pub(super) fn object(
        &mut self,
        member: &mut dyn FnMut(&mut Self, &str) -> Result<(), Untaken>,
    ) -> Result<(), Untaken> {
        self.expect("{", "an object")?;
        self.until("}", &mut |reader| {
            let mut name = String::<NAME_BYTES_MAX>::new();
            reader.text(&mut name)?;
            reader.expect(":", "a colon")?;
            member(reader, &name)
        })
    }

    /// Reads a list; `item` reads an item.
    pub(super) fn list(&mut self, item: Part<'_, 'b>) -> Result<(), Untaken> {
        self.expect("[", "a list")?;
        self.until("]", item)
    }

    fn until(&mut self, end: &str, part: Part<'_, 'b>) -> Result<(), Untaken> {
        if self.takes(end) {
            return Ok(());
        }
        loop {
            part(self)?;
            if self.takes(end) {
                return Ok(());
            }
            self.expect(",", "a comma")?;
        }
    }

    /// Passes by a list, whatever is in it.
    pub(super) fn skip_list(&mut self) -> Result<(), Untaken> {
        self.expect("[", "a list")?;
        let mut depth = 1_usize;
        while depth > 0 {
            if self.takes("\"") {
                self.chars(&mut |_| Ok(()))?;
                continue;
            }
            match self.char() {
                Some('[' | '{') => depth += 1,
                Some(']' | '}') => depth -= 1,
                Some(_) => {}
                None => return Err(self.expected("the end of the list")),
            }
        }
        Ok(())
    }

    /// Reads a text.
    pub(super) fn text(&mut self, out: &mut dyn Write) -> Result<(), Untaken> {
        self.expect("\"", "a text")?;
        self.chars(&mut |char| out.write_char(char))
    }

    fn chars(&mut self, take: &mut dyn FnMut(char) -> core::fmt::Result) -> Result<(), Untaken> {
        loop {
            let char = match self.char() {
                Some('"') => return Ok(()),
                Some('\\') => self.escaped()?,
                Some(char) if char >= ' ' => char,
                _ => return Err(self.expected("the end of the text")),
            };
            take(char).map_err(|_| self.expected("a shorter text"))?;
        }
    }

    fn escaped(&mut self) -> Result<char, Untaken> {
        let char = match self.char() {
            Some(char @ ('"' | '\\' | '/')) => Some(char),
            Some('b') => Some('\x08'),
            Some('f') => Some('\x0c'),
            Some('n') => Some('\n'),
            Some('r') => Some('\r'),
            Some('t') => Some('\t'),
            Some('u') => {
                let first = self.unit();
                // A character outside the basic plane is a pair.
                let is_pair =
                    first.is_some_and(|unit| unit & 0xfc00 == 0xd800) && self.rest.starts_with("\\u");
                let second = if is_pair && self.takes("\\u") { self.unit() } else { None };
                char::decode_utf16(first.into_iter().chain(second)).next().and_then(Result::ok)
            }
            _ => None,
        };
        char.ok_or_else(|| self.expected("an escaped character"))
    }

    /// Four hexadecimal digits.
    fn unit(&mut self) -> Option<u16> {
        let (digits, rest) = self.rest.split_at_checked(4)?;
        self.rest = rest;
        let is_number = digits.bytes().all(|byte| byte.is_ascii_hexdigit());
        u16::from_str_radix(digits, 16).ok().filter(|_| is_number)
    }

    /// Reads a number, and returns its digits, without a fraction of zeros.
    pub(super) fn number(&mut self) -> Result<&'b str, Untaken> {
        self.takes("");
        let end =
            self.rest.find(|char: char| !char.is_ascii_alphanumeric() && !matches!(char, '+' | '-' | '.'));
        let (number, rest) = self.rest.split_at(end.unwrap_or(self.rest.len()));
        if !is_number(number) {
            return Err(self.expected("a number"));
        }
        self.rest = rest;
        let (whole, fraction) = number.split_once('.').unwrap_or((number, ""));
        Ok(if fraction.bytes().all(|byte| byte == b'0') { whole } else { number })
    }

    /// Reads a whole number up to `most`.
    pub(super) fn whole(&mut self, most: u32) -> Result<u32, Untaken> {
        let before = self.rest;
        let number = self.number()?.parse().ok().filter(|number| *number <= most);
        number.ok_or_else(|| {
            self.rest = before;
            self.expected("a whole number, not above its limit")
        })
    }

    pub(super) fn flag(&mut self) -> Result<bool, Untaken> {
        let is_set = self.takes("true");
        if is_set || self.takes("false") { Ok(is_set) } else { Err(self.expected("true or false")) }
    }
}

fn is_number(text: &str) -> bool {
    let is_digits = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    let text = text.strip_prefix('-').unwrap_or(text);
    let (digits, ten) = text.split_once('e').or_else(|| text.split_once('E')).unwrap_or((text, "0"));
    let (whole, fraction) = digits.split_once('.').unwrap_or((digits, "0"));
    let ten = ten.strip_prefix('+').or_else(|| ten.strip_prefix('-')).unwrap_or(ten);
    let begins = whole == "0" || !whole.starts_with('0');
    begins && is_digits(whole) && is_digits(fraction) && is_digits(ten)
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::format;
    use std::string::{String, ToString};

    use proptest::prelude::*;
    use serde_json::Value;

    use super::*;

    fn text(json: &str) -> Option<String> {
        let (mut reader, mut text) = (Reader::new(json), String::new());
        reader.text(&mut text).and_then(|()| reader.end()).ok().map(|()| text)
    }

    fn number(json: &str) -> Option<&str> {
        let mut reader = Reader::new(json);
        let number = reader.number();
        reader.end().ok().and(number.ok())
    }

    proptest! {
        #[test]
        fn any_text_is_read_as_others_write_and_read_it(expected in any::<String>(), json in "\"[a\\\\\"/u0d8c\u{1}é]{0,16}\"") {
            prop_assert_eq!(text(&Value::from(expected.clone()).to_string()), Some(expected));
            prop_assert_eq!(text(&json), serde_json::from_str(&json).ok());
        }

        #[test]
        fn a_number_is_one_for_others(json in "[-+.0123eE]{1,8}") {
            let is_one = matches!(serde_json::from_str(&json), Ok(Value::Number(_)));
            // Others refuse what a float cannot have.
            prop_assert!(number(&json).is_some() == is_one || json.contains(['e', 'E']) && number(&json).is_some());
        }
    }

    #[test]
    fn characters_are_escaped_by_letters_or_numbers() {
        assert_eq!(text(r#""\u00e9\ud83d\ude00\n\t\/\"\\""#).unwrap(), "é😀\n\t/\"\\");
        for wrong in ["\"\\ud83d\"", "\"\\ud83d\\u0041\"", "\"\\u+0e9\"", "\"\\x\"", "\"a\nb\"", "\"a", "a"] {
            assert_eq!(text(wrong), None, "{wrong}");
        }
    }

    #[test]
    fn a_number_keeps_its_digits_but_a_fraction_of_zeros() {
        for (json, digits) in
            [("7", "7"), ("-1.50", "-1.50"), ("2.00", "2"), ("1e+3", "1e+3"), ("1.0e3", "1.0e3")]
        {
            assert_eq!(number(json), Some(digits));
        }
        for wrong in ["", "-", "01", "1.", ".5", "+1", "1e", "0x1", "1 2", "true"] {
            assert_eq!(number(wrong), None, "{wrong}");
        }
    }

    #[test]
    fn an_error_names_what_is_expected_and_where() {
        let read = |json: &str| {
            let mut reader = Reader::new(json);
            let read = reader.object(&mut |reader, _| reader.list(&mut |reader| reader.whole(9).map(drop)));
            format!("{}", read.and_then(|()| reader.end()).unwrap_err())
        };
        for (json, why) in [
            ("[]", "expected an object at byte 1"),
            ("{\"a\" 1}", "expected a colon at byte 6"),
            ("{\"a\":1}", "expected a list at byte 6"),
            ("{\"a\":[1 2]}", "expected a comma at byte 9"),
            ("{\"a\":[10]}", "expected a whole number, not above its limit at byte 7"),
            ("{\"a\":[]} x", "expected nothing behind the object at byte 10"),
            ("{\"abcdefghijklmnopqrstuvwxy\":[]}", "expected a shorter text at byte 28"),
        ] {
            assert!(read(json).ends_with(why), "{json}: {}", read(json));
        }
        assert_eq!(Reader::new("[[\"]\"]] x").skip_list().map_err(|error| error.to_string()), Ok(()));
    }
}
