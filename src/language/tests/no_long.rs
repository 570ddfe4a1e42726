//! What lines of points say in images without `long-values`. Run by `cargo test -p mobgate --lib --no-default-features --features
//! ipv6,points`.

use std::string::ToString;

use super::{PORTS, load, std};
use crate::language::{Problem, apply};

#[test]
fn words_that_the_image_lacks_are_named_and_change_nothing() {
    let mut settings = load(PORTS);
    for line in ["port ask scanner", "port field ethercat", "device meter unit 5"] {
        apply(&mut settings, line).unwrap();
    }
    let before = settings.clone();
    for (line, word) in [
        ("point power meter holding 0 as u64", "u64"),
        ("point power meter holding 0 as text 8", "text"),
        ("point power local holding 0 as f64", "f64"),
        ("point power meter holding 0 scale 0.1", "scale"),
        ("point power local holding 0 offset -40", "offset"),
        ("point power meter holding 0 bits 4-7", "bits"),
        ("point power meter holding 0 write every 30s", "every"),
        ("slave 0 unit 7 input 0 as i64", "i64"),
    ] {
        let error = apply(&mut settings, line).expect_err(line);
        assert_eq!((error.word.as_str(), &error.problem), (word, &Problem::NoLongValues), "{line}");
        assert!(
            error.to_string().ends_with(": this board's image lacks it (feature long-values)"),
            "{error}"
        );
    }
    for (line, says) in [
        ("point power meter holding 0 as u63", "expected u16, i16, u32, i32 or f32"),
        ("point power meter holding 0 every 30s", "this board's image lacks it (feature long-values)"),
        ("point power meter holding 0 sizes 3", "expected count, as, bit, read, write, multiple or label"),
        ("point power meter holding 0 write always", "expected auto, change or manual"),
    ] {
        let error = apply(&mut settings, line).expect_err(line).to_string();
        assert!(error.ends_with(says), "{error}");
    }
    assert_eq!(settings, before);
}
