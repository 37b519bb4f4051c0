//! The README's picture of a report is taken from a report of today's program.

use std::path::{Path, PathBuf};

use base64::Engine as _;
use cardiotwin_chromium::{Browser, Look};

/// Size of the picture \[px\], and the time of the beat that it shows \[ms\].
const LOOK: Look = Look {
    width: 1400,
    height: 1530,
    dark: false,
};
const SHOWN_MS: u32 = 180;

/// Edge of the cells whose mean colours are compared \[px\].
const CELL_PX: u32 = 10;
/// Difference of a mean colour that counts, of 255, and share of such cells that is allowed: a picture with the numbers of four days
/// before differs in 0.9 %.
const LARGEST_DIFFERENCE: u32 = 24;
const LARGEST_SHARE: f64 = 0.006;

/// Share of the cells in which two pictures differ; 1 for pictures of other sizes.
const DIFFERENCE: &str = r#"(async () => {
  const cells = async (data) => {
    const image = new Image();
    image.src = "data:image/png;base64," + data;
    await image.decode();
    const [w, h] = [Math.ceil(image.width / CELL), Math.ceil(image.height / CELL)];
    const [whole, sums] = [document.createElement("canvas"), new Float64Array(3 * w * h)];
    [whole.width, whole.height] = [image.width, image.height];
    const context = whole.getContext("2d");
    context.drawImage(image, 0, 0);
    const pixels = context.getImageData(0, 0, image.width, image.height).data;
    for (let y = 0; y < image.height; y++)
      for (let x = 0; x < image.width; x++)
        for (let c = 0; c < 3; c++)
          sums[3 * (Math.floor(y / CELL) * w + Math.floor(x / CELL)) + c] += pixels[4 * (y * image.width + x) + c] / CELL / CELL;
    return { size: [image.width, image.height].join(), sums };
  };
  const [a, b] = [await cells(A), await cells(B)];
  if (a.size !== b.size) return 1;
  let differ = 0;
  for (let cell = 0; cell < a.sums.length; cell += 3)
    differ += [0, 1, 2].some((c) => Math.abs(a.sums[cell + c] - b.sums[cell + c]) > MOST);
  return differ / (a.sums.length / 3);
})()"#;

/// Photographs a patient of a report as the README shows it.
fn photograph(browser: &Browser, report: &Path, patient: &str, to: &Path) {
    let url = format!("file://{}#{patient}", report.display());
    let mut page = browser.open(&url, LOOK).expect("the report opens");
    let slide = format!(
        "(async () => {{ const wait = () => new Promise((done) => setTimeout(done, 500)); await wait(); \
         const slider = document.querySelector('section.patient:not([hidden]) .player input'); \
         slider.value = {SHOWN_MS}; slider.dispatchEvent(new Event('input')); await wait(); return 1; }})()"
    );
    page.value(&slide).expect("the slider moves");
    page.photograph(to).expect("a picture");
}

fn encoded(file: &Path) -> String {
    let bytes = std::fs::read(file).unwrap_or_else(|error| panic!("{}: {error}", file.display()));
    base64::engine::general_purpose::STANDARD.encode(bytes)
}

/// Asserts that `shown` is the picture of a patient in `report`, up to the fonts and numbers of another machine. The new picture
/// is kept among the outputs of the build.
pub fn assert_is_of(report: &Path, patient: &str, shown: &Path) {
    let Some(browser) = Browser::find() else {
        cardiotwin_not_tested::not_tested(
            "browser",
            "no Chromium in PATH; `make deps` installs it",
        );
        return;
    };
    let taken = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("report.png");
    photograph(&browser, report, patient, &taken);
    let script = DIFFERENCE
        .replace("CELL", &CELL_PX.to_string())
        .replace("MOST", &LARGEST_DIFFERENCE.to_string())
        .replace("(A)", &format!("(\"{}\")", encoded(shown)))
        .replace("(B)", &format!("(\"{}\")", encoded(&taken)));
    let mut page = browser.open("data:text/html,<p>", LOOK).expect("a page");
    let share = page.value(&script).expect("both pictures are read");
    let share = share.as_f64().expect("a number");
    assert!(
        share <= LARGEST_SHARE,
        "{} differs from today's report in {:.1} % of its area; if the report is right: cp {} {}",
        shown.display(),
        100.0 * share,
        taken.display(),
        shown.display()
    );
}
