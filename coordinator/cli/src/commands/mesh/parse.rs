//! Parsers for arguments that consist of more than one number or word.

use cardiotwin_mesh::repair::Plane;
use cardiotwin_mesh::vec3::{Vec3, unit};

fn numbers<const N: usize>(text: &str, expected: &str) -> Result<[f64; N], String> {
    let refuse = || format!("expected {expected}");
    let words: Vec<&str> = text.split(',').map(str::trim).collect();
    let words: [&str; N] = words.try_into().map_err(|_| refuse())?;
    let mut values = [0.0; N];
    for (value, word) in values.iter_mut().zip(words) {
        *value = word
            .parse()
            .ok()
            .filter(|v: &f64| v.is_finite())
            .ok_or_else(refuse)?;
    }
    Ok(values)
}

/// Parses `x,y,z`, a point in mm.
pub fn point(text: &str) -> Result<Vec3, String> {
    numbers::<3>(text, "x,y,z in mm")
}

/// Parses `x,y,z,nx,ny,nz`: a point in mm and a normal, which is scaled to unit length.
pub fn plane(text: &str) -> Result<Plane, String> {
    let [x, y, z, nx, ny, nz] = numbers::<6>(text, "x,y,z,nx,ny,nz: a point in mm and a normal")?;
    let normal = unit([nx, ny, nz]).ok_or("the normal has no length")?;
    Ok(Plane {
        point_mm: [x, y, z],
        normal,
    })
}

/// New and old name of an argument `NEW=OLD`, neither of them empty.
pub fn pair(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((new, old)) if !new.is_empty() && !old.is_empty() => {
            Ok((new.to_owned(), old.to_owned()))
        }
        _ => Err("expected NEW=OLD".to_owned()),
    }
}

/// Parses `NEW=OLD` with two tags.
pub fn tags(text: &str) -> Result<(i32, i32), String> {
    let refuse = || "expected NEW=OLD, two whole numbers".to_owned();
    let (new, old) = text.split_once('=').ok_or_else(refuse)?;
    Ok((
        new.trim().parse().map_err(|_| refuse())?,
        old.trim().parse().map_err(|_| refuse())?,
    ))
}

/// Parses a finite number above zero.
pub fn positive(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|v: &f64| *v > 0.0 && v.is_finite())
        .ok_or_else(|| "expected a number above 0".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_points_and_pairs_are_read_or_refused() {
        assert_eq!(point("1, -2,3.5"), Ok([1.0, -2.0, 3.5]));
        assert!(point("1,2").is_err() && point("1,2,inf").is_err());
        assert_eq!(plane("0,0,5,0,0,2").unwrap().normal, [0.0, 0.0, 1.0]);
        assert!(plane("0,0,5,0,0,0").is_err());
        assert_eq!(pair("rim=base"), Ok(("rim".to_owned(), "base".to_owned())));
        assert!(pair("rim").is_err() && pair("=base").is_err());
        assert_eq!(tags("2=7"), Ok((2, 7)));
        assert!(tags("2=x").is_err() && positive("-1").is_err() && positive("0.5").is_ok());
    }
}
