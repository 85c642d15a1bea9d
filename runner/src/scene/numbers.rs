//! Numbers as words of a statement, read and written without text in between.

use std::io::Write as _;

/// Whether a number is written so that it can be neither infinite nor NaN, and needs no closer look.
pub fn is_plain(word: &[u8]) -> bool {
    word.len() <= 16 && word.iter().all(|byte| matches!(byte, b'0'..=b'9' | b'.' | b'-' | b'+'))
}

/// The number that a word is, if it is one: infinite and NaN too.
pub fn parse(word: &[u8]) -> Option<f64> {
    std::str::from_utf8(word).ok()?.parse().ok()
}

/// The whole number that a word is, or one far outside any range.
pub fn parse_index(word: &[u8]) -> Option<i64> {
    let (negative, digits) = match word {
        [b'-', digits @ ..] => (true, digits),
        [b'+', digits @ ..] => (false, digits),
        digits => (false, digits),
    };
    if digits.is_empty() {
        return None;
    }
    let mut index = 0_i64;
    for byte in digits {
        let digit = byte.checked_sub(b'0').filter(|digit| *digit < 10)?;
        // Saturates far outside any range.
        index = index.saturating_mul(10).saturating_add(i64::from(digit));
    }
    Some(if negative { -index } else { index })
}

/// Appends a blank and a word.
pub fn write_word(out: &mut Vec<u8>, word: &[u8]) {
    out.push(b' ');
    out.extend_from_slice(word);
}

/// Appends a blank and a number, exactly.
pub fn write_number(out: &mut Vec<u8>, number: f64) {
    write!(out, " {number:e}").expect("writing to memory succeeds");
}

/// Appends a blank and `v/vt/vn`.
pub fn write_corner(out: &mut Vec<u8>, indices: [u32; 3]) {
    let mut digits = [0_u8; 33];
    let mut start = digits.len();
    for (list, &index) in indices.iter().enumerate().rev() {
        let mut rest = index;
        loop {
            start -= 1;
            digits[start] = b'0' + (rest % 10) as u8;
            rest /= 10;
            if rest == 0 {
                break;
            }
        }
        start -= 1;
        digits[start] = if list == 0 { b' ' } else { b'/' };
    }
    out.extend_from_slice(&digits[start..]);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn indices_are_whole_numbers_with_a_sign() {
        let cases: [(&str, Option<i64>); 8] = [
            ("12", Some(12)),
            ("+7", Some(7)),
            ("-3", Some(-3)),
            ("99999999999999999999", Some(i64::MAX)),
            ("1.0", None),
            ("", None),
            ("-", None),
            ("1e3", None),
        ];
        for (word, expected) in cases {
            assert_eq!(parse_index(word.as_bytes()), expected, "{word}");
        }
    }

    #[test]
    fn plain_numbers_cannot_overflow() {
        assert!(is_plain(b"-123.456") && is_plain(b"9999999999999999"));
        for word in ["1e9", "nan", "inf", "99999999999999999", "0x10"] {
            assert!(!is_plain(word.as_bytes()), "{word}");
        }
    }

    #[test]
    fn corners_are_written_in_decimal() {
        let mut out = b"f".to_vec();
        write_corner(&mut out, [1, 20, 4_294_967_295]);
        write_corner(&mut out, [0, 1, 10]);
        assert_eq!(out, b"f 1/20/4294967295 0/1/10");
    }
}
