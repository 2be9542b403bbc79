//! Reads `ID=VALUE` arguments.

/// `ID=VALUE`, for clap.
pub fn id_and_number(text: &str) -> Result<(u32, f64), String> {
    let (id, value) = text.split_once('=').ok_or("write ID=FACTOR, such as 3=5")?;
    Ok((id.parse().map_err(|e| format!("id {id}: {e}"))?, number(value)?))
}

/// `ID=VX,VY`, for clap.
pub fn id_and_vector(text: &str) -> Result<(u32, [f64; 2]), String> {
    let wrong = "write ID=VX,VY, such as 3=0.5,-1";
    let (id, value) = text.split_once('=').ok_or(wrong)?;
    let (x, y) = value.split_once(',').ok_or(wrong)?;
    Ok((id.parse().map_err(|e| format!("id {id}: {e}"))?, [number(x)?, number(y)?]))
}

fn number(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|e| format!("{text}: {e}"))?;
    let advice = "give a finite number, such as 1000 for a factor that is practically infinite";
    if value.is_finite() { Ok(value) } else { Err(format!("{text} is not finite; {advice}")) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_are_read_or_explained() {
        assert_eq!(id_and_number("3=0.2"), Ok((3, 0.2)));
        assert_eq!(id_and_vector("3=0.5,-1"), Ok((3, [0.5, -1.0])));
        for wrong in ["3", "x=1", "3=", "3=nan", "-1=2"] {
            assert!(id_and_number(wrong).is_err(), "{wrong}");
        }
    }
}
