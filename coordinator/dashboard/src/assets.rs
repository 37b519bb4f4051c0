//! Files of the page, which are part of the program.

/// A file of the page.
pub struct Asset {
    /// Path in the address.
    pub path: &'static str,
    /// Value of the header `Content-Type`.
    pub kind: &'static str,
    /// Content of the file, compiled into the program.
    pub text: &'static str,
}

/// Media type of pages.
pub const HTML: &str = "text/html; charset=utf-8";
/// Media type of style sheets.
pub const CSS: &str = "text/css; charset=utf-8";
/// Media type of scripts.
pub const JS: &str = "text/javascript; charset=utf-8";

macro_rules! assets {
    ($($path:literal $kind:ident $file:literal;)*) => {
        /// Every file that the server has, whoever asks.
        pub const ALL: &[Asset] = &[$(Asset { path: $path, kind: $kind, text: include_str!(concat!("../assets/", $file)) },)*];
    };
}

assets! {
    "/" HTML "index.html";
    "/dashboard.css" CSS "dashboard.css";
    "/theme.js" JS "theme.js";
    "/app.js" JS "app.js";
    "/words.js" JS "words.js";
    "/table.js" JS "table.js";
    "/cohort.js" JS "cohort.js";
    "/patient.js" JS "patient.js";
    "/beat.js" JS "beat.js";
    "/compare.js" JS "compare.js";
    "/queue.js" JS "queue.js";
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A page that fetches from elsewhere tells it who looks at which cohort.
    #[test]
    fn nothing_comes_from_the_network_and_nothing_is_inline() {
        for asset in ALL {
            for outward in [
                "http://",
                "https://",
                "//cdn",
                "@import",
                "eval(",
                "style=\"",
                " onclick=",
            ] {
                let svg = asset.text.replace("http://www.w3.org/2000/svg", "");
                assert!(!svg.contains(outward), "{} has {outward}", asset.path);
            }
        }
    }

    #[test]
    fn every_file_that_the_page_names_exists() {
        for asset in ALL {
            let quoted = asset.text.split(['"', '\'']).skip(1).step_by(2);
            for name in quoted.filter(|name| name.starts_with("./") && name.ends_with(".js")) {
                let path = &name[1..];
                // The drawings' scripts come from the source.
                let is_drawing = ["/report.js", "/heart.js"].contains(&path);
                assert!(
                    is_drawing || ALL.iter().any(|other| other.path == path),
                    "{} names {name}",
                    asset.path
                );
            }
        }
    }
}
