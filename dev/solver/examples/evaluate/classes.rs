//! Effects that look alike in pressure and volume.

/// Effects that these data can hardly distinguish; a result may be right up to the class.
const CLASSES: [[&str; 2]; 3] = [
    ["mitral_regurgitation", "ventricular_septal_defect"],
    ["passive_stiffening", "pericardial_constraint"],
    ["aortic_stenosis", "wave_reflection"],
];

/// Whether two effects are equal or look alike.
pub fn same_class(a: &str, b: &str) -> bool {
    a == b
        || CLASSES
            .iter()
            .any(|class| class.contains(&a) && class.contains(&b))
}
