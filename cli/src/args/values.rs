//! Values of options with units.

/// A time in seconds, from 0.001 to 1e9.
pub fn seconds(text: &str) -> Result<f64, String> {
    let seconds = text.parse().ok().filter(|seconds: &f64| (1e-3..=1e9).contains(seconds));
    seconds.ok_or_else(|| format!("`{text}` is not a number of seconds from 0.001 to 1e9"))
}

/// A number of squares of a chequered pattern.
pub fn squares(text: &str) -> Result<usize, String> {
    text.parse().map_err(|_| {
        format!(
            "`{text}` is not a number of squares, such as 16. What follows --checker is taken for one: name a model before \
             it"
        )
    })
}

/// A number, or `off` for none.
pub fn off_or_count(text: &str) -> Result<usize, String> {
    if text == "off" {
        return Ok(0);
    }
    text.parse()
        .map_err(|_| format!("`{text}` is neither `off` nor a number of cells"))
}

/// A positive number.
pub fn effort(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(number) if number > 0.0 => Ok(number),
        _ => Err(format!("`{text}` is not a positive number of iterations")),
    }
}

/// A positive, finite number.
pub fn positive(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(number) if number > 0.0 && f64::is_finite(number) => Ok(number),
        _ => Err(format!("`{text}` is not a positive number")),
    }
}

/// A finite number of 1 or more.
pub fn at_least_one(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(number) if number >= 1.0 && f64::is_finite(number) => Ok(number),
        _ => Err(format!("`{text}` is not a number of 1 or more")),
    }
}

/// A share from 0 to 1.
pub fn share(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(number) if (0.0..=1.0).contains(&number) => Ok(number),
        _ => Err(format!("`{text}` is not a share from 0 to 1")),
    }
}

/// A number of bytes with an optional unit: KB, MB, GB, TB are powers of 1000; K, KiB and so on of 1024.
pub fn bytes(text: &str) -> Result<u64, String> {
    let wanted = || format!("`{text}` is not a size; write it as 4GiB, 500MB or a number of bytes");
    let end = text.trim().find(|c: char| c.is_ascii_alphabetic() || c == ' ');
    let (number, unit) = text.trim().split_at(end.unwrap_or(text.trim().len()));
    let unit = unit.trim().to_lowercase();
    let (prefix, base) = match unit.strip_suffix("ib").or(unit.strip_suffix('b')) {
        _ if unit == "b" => ("", 1),
        Some(prefix) if unit.ends_with("ib") => (prefix, 1024u64),
        Some(prefix) => (prefix, 1000),
        None => (unit.as_str(), 1024),
    };
    let power = ["", "k", "m", "g", "t"].iter().position(|p| *p == prefix);
    let factor = base.pow(power.ok_or_else(wanted)? as u32) as f64;
    let number: f64 = number.parse().map_err(|_| wanted())?;
    if number.is_finite() && number > 0.0 {
        Ok((number * factor) as u64)
    } else {
        Err(wanted())
    }
}
