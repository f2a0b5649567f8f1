/// A number in plain ASCII with at most `digits` significant digits: fixed notation from `1e-3` up to `1e6`, scientific
/// beyond, trailing zeros dropped. `1234.5` with 3 digits is `1234` (whole digits are never rounded away).
pub fn significant(value: f64, digits: usize) -> String {
    if value == 0.0 || !value.is_finite() {
        return format!("{}", value + 0.0);
    }
    let (mantissa, exponent) = decimal(value, digits);
    if (-3..6).contains(&exponent) {
        let decimals = (digits as i32 - 1 - exponent).max(0) as usize;
        without_trailing_zeros(format!("{value:.decimals$}"))
    } else {
        format!("{mantissa}e{exponent}")
    }
}

/// The same for pictures: a true minus sign, and powers of ten as `1.2×10⁻⁷`.
pub(super) fn typeset(value: f64, digits: usize) -> String {
    let text = significant(value, digits);
    match text.split_once('e') {
        Some(("1", exponent)) => format!("10{}", superscript(exponent)),
        Some((mantissa, exponent)) => format!("{mantissa}×10{}", superscript(exponent)),
        None => text,
    }
    .replace('-', "−")
}

/// `10ⁿ`.
pub(super) fn ten_to_the(exponent: i32) -> String {
    format!("10{}", superscript(&exponent.to_string()))
}

fn superscript(digits: &str) -> String {
    let raised = |c: char| match c {
        '-' => '⁻',
        c => c
            .to_digit(10)
            .map_or(c, |d| ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'][d as usize]),
    };
    digits.chars().map(raised).collect()
}

/// Mantissa of `digits` significant digits and exponent after rounding, so that 9.99 becomes 1e1 and not 10e0.
fn decimal(value: f64, digits: usize) -> (String, i32) {
    let text = format!("{value:.*e}", digits.saturating_sub(1));
    match text.split_once('e') {
        Some((mantissa, exponent)) => (
            without_trailing_zeros(mantissa.to_owned()),
            exponent.parse().unwrap_or(0),
        ),
        None => (text, 0),
    }
}

fn without_trailing_zeros(text: String) -> String {
    if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_keep_their_significant_digits() {
        for (value, digits, text) in [
            (0.0, 3, "0"),
            (-0.0, 3, "0"),
            (1234.5, 3, "1234"),
            (0.012345, 3, "0.0123"),
            (2.0, 3, "2"),
            (9.999, 3, "10"),
            (-1.5e-7, 3, "-1.5e-7"),
            (1e6, 2, "1e6"),
            (999_999.9, 3, "1e6"),
            (f64::NAN, 3, "NaN"),
        ] {
            assert_eq!(significant(value, digits), text);
        }
    }

    #[test]
    fn powers_of_ten_are_typeset() {
        assert_eq!(typeset(-1.5e-7, 3), "−1.5×10⁻⁷");
        assert_eq!(typeset(1e12, 3), "10¹²");
        assert_eq!(typeset(-0.25, 3), "−0.25");
    }
}
