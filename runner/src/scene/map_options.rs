//! Options in front of the file name of a texture, as in `map_Kd -s 2 2 1 -clamp on wood.png`.

use super::lines::{decode, excerpt, split_keyword};
use super::numbers::parse as number;

/// Splits the options in front of a file name from it; returns those that would change the picture.
pub fn split_options(rest: &[u8]) -> (Vec<String>, &[u8]) {
    let mut ignored = Vec::new();
    let mut rest = rest;
    loop {
        let (option, after) = split_keyword(rest);
        // How many values an option has: at least, at most.
        let (least, most, neutral): (usize, usize, &[u8]) = match option {
            b"-s" => (1, 3, b"1"),
            b"-o" | b"-t" => (1, 3, b"0"),
            b"-mm" => (2, 2, b""),
            b"-bm" | b"-boost" => (1, 1, b""),
            b"-clamp" | b"-cc" => (1, 1, b"off"),
            b"-blendu" | b"-blendv" => (1, 1, b"on"),
            b"-texres" | b"-type" | b"-imfchan" | b"-colorspace" => (1, 1, b""),
            _ => return (ignored, rest),
        };
        let mut text = decode(option);
        let mut changes = false;
        rest = after;
        for index in 0..most {
            let (value, after) = split_keyword(rest);
            // The last word is the file name, even one that looks like a number.
            if value.is_empty() || after.is_empty() || (index >= least && number(value).is_none()) {
                break;
            }
            let same = value == neutral || (number(value).is_some() && number(value) == number(neutral));
            changes |= !same && !matches!(option, b"-bm" | b"-texres" | b"-boost" | b"-blendu" | b"-blendv");
            text.push(' ');
            text.push_str(&excerpt(value));
            rest = after;
        }
        if changes {
            ignored.push(text);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn file_names_keep_their_blanks_and_lose_the_options() {
        let cases = [
            ("t.png", "t.png"),
            ("-s 1 1 1 t.png", "t.png"),
            ("-s 2 two words.png", "two words.png"),
            ("-o 1 1 1 1", "1"),
            ("-clamp on -imfchan m a.png", "a.png"),
            ("-unknown 1 a.png", "-unknown 1 a.png"),
        ];
        for (rest, name) in cases {
            assert_eq!(split_options(rest.as_bytes()).1, name.as_bytes(), "{rest}");
        }
    }

    #[test]
    fn only_options_that_change_the_picture_are_reported() {
        assert_eq!(split_options(b"-s 1 1 1 -o 0 0 -bm 3 -clamp off -blendu on t.png").0, Vec::<String>::new());
        assert_eq!(split_options(b"-s 2 2 1 -o 0 0 0 -clamp on t.png").0, ["-s 2 2 1", "-clamp on"]);
    }
}
