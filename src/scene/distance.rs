//! Exact distances between points, segments and triangles, metres.
//!
//! These are the leaf tests under the bounding volume hierarchy of [`super::clearance`]. They are computed in double precision
//! from the triangle alone, so that an answer never depends on the shape of the tree above it. The closest-point case analysis is
//! the classical one by Voronoi regions (Ericson, "Real-Time Collision Detection", 2005, section 5.1).

use nalgebra::{Point3, Vector3};

use super::proxy::Triangle;

/// Parameter `t` in (0, 1) at which the segment from `a` to `b` passes through `triangle`, from either side.
pub fn segment_hits_triangle(a: &Point3<f64>, direction: &Vector3<f64>, triangle: &Triangle) -> bool {
    /// Rays through the seam of two triangles must not slip between them.
    const SEAM: f64 = 1e-9;
    let edge1 = triangle[1] - triangle[0];
    let edge2 = triangle[2] - triangle[0];
    let p = direction.cross(&edge2);
    let determinant = edge1.dot(&p);
    if determinant == 0.0 {
        return false;
    }
    let inverse = 1.0 / determinant;
    let from_corner = a - triangle[0];
    let u = from_corner.dot(&p) * inverse;
    if !(-SEAM..=1.0 + SEAM).contains(&u) {
        return false;
    }
    let q = from_corner.cross(&edge1);
    let v = direction.dot(&q) * inverse;
    if v < -SEAM || u + v > 1.0 + SEAM {
        return false;
    }
    let t = edge2.dot(&q) * inverse;
    t > 0.0 && t < 1.0
}

/// Squared distance of a point to a triangle, m^2.
pub fn point_triangle_squared(p: &Point3<f64>, triangle: &Triangle) -> f64 {
    (p - closest_on_triangle(p, triangle)).norm_squared()
}

/// Squared distance of the segment `a`-`b` to a triangle, m^2.
pub fn segment_triangle_squared(a: &Point3<f64>, b: &Point3<f64>, triangle: &Triangle) -> f64 {
    if segment_hits_triangle(a, &(b - a), triangle) {
        return 0.0;
    }
    let [p, q, r] = triangle;
    point_triangle_squared(a, triangle)
        .min(point_triangle_squared(b, triangle))
        .min(segment_segment_squared(a, b, p, q))
        .min(segment_segment_squared(a, b, q, r))
        .min(segment_segment_squared(a, b, r, p))
}

fn closest_on_triangle(p: &Point3<f64>, [a, b, c]: &Triangle) -> Point3<f64> {
    let (ab, ac) = (b - a, c - a);
    let ap = p - a;
    let (d1, d2) = (ab.dot(&ap), ac.dot(&ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return *a;
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(&bp), ac.dot(&bp));
    if d3 >= 0.0 && d4 <= d3 {
        return *b;
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 && d1 > d3 {
        return a + ab * (d1 / (d1 - d3));
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(&cp), ac.dot(&cp));
    if d6 >= 0.0 && d5 <= d6 {
        return *c;
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 && d2 > d6 {
        return a + ac * (d2 / (d2 - d6));
    }
    let va = d3 * d6 - d5 * d4;
    let (along, against) = (d4 - d3, d5 - d6);
    if va <= 0.0 && along >= 0.0 && against >= 0.0 && along + against > 0.0 {
        return b + (c - b) * (along / (along + against));
    }
    let sum = va + vb + vc;
    if sum == 0.0 { *a } else { a + ab * (vb / sum) + ac * (vc / sum) }
}

fn segment_segment_squared(p1: &Point3<f64>, q1: &Point3<f64>, p2: &Point3<f64>, q2: &Point3<f64>) -> f64 {
    let (d1, d2, r) = (q1 - p1, q2 - p2, p1 - p2);
    let (a, e) = (d1.norm_squared(), d2.norm_squared());
    let (c, f) = (d1.dot(&r), d2.dot(&r));
    let (s, t) = if a == 0.0 && e == 0.0 {
        (0.0, 0.0)
    } else if a == 0.0 {
        (0.0, (f / e).clamp(0.0, 1.0))
    } else if e == 0.0 {
        ((-c / a).clamp(0.0, 1.0), 0.0)
    } else {
        let b = d1.dot(&d2);
        let denominator = a * e - b * b;
        let s = if denominator > 0.0 { ((b * f - c * e) / denominator).clamp(0.0, 1.0) } else { 0.0 };
        let t = (b * s + f) / e;
        if t < 0.0 {
            ((-c / a).clamp(0.0, 1.0), 0.0)
        } else if t > 1.0 {
            (((b - c) / a).clamp(0.0, 1.0), 1.0)
        } else {
            (s, t)
        }
    };
    ((p1 + d1 * s) - (p2 + d2 * t)).norm_squared()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn point() -> impl Strategy<Value = Point3<f64>> {
        [-20.0..20.0f64, -20.0..20.0f64, -20.0..20.0f64].prop_map(|[x, y, z]| Point3::new(x, y, z))
    }

    /// Distance by brute force: both sides are sampled finely, so the result is never too small and at most one step too large.
    fn sampled_distance(a: &Point3<f64>, b: &Point3<f64>, triangle: &Triangle) -> f64 {
        const STEPS: usize = 60;
        let share = |i: usize| i as f64 / STEPS as f64;
        let mut best = f64::INFINITY;
        for i in 0..=STEPS {
            let p = a + (b - a) * share(i);
            for j in 0..=STEPS {
                for k in 0..=STEPS - j {
                    let q = triangle[0] + (triangle[1] - triangle[0]) * share(j) + (triangle[2] - triangle[0]) * share(k);
                    best = best.min((p - q).norm());
                }
            }
        }
        best
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        #[test]
        fn segment_distance_agrees_with_dense_sampling(a in point(), b in point(), p in point(), q in point(), r in point()) {
            let triangle = [p, q, r];
            let exact = segment_triangle_squared(&a, &b, &triangle).sqrt();
            let sampled = sampled_distance(&a, &b, &triangle);
            let step = ((b - a).norm() + (q - p).norm() + (r - p).norm()) / 60.0;
            prop_assert!(exact <= sampled + 1e-9, "{exact} > {sampled}");
            prop_assert!(exact >= sampled - step, "{exact} < {sampled} - {step}");
        }

        #[test]
        fn segment_distance_agrees_with_parry(a in point(), b in point(), p in point(), q in point(), r in point()) {
            use parry3d::math::{Pose, Vector};
            use parry3d::query;
            use parry3d::shape::{Segment, Triangle as ParryTriangle};
            let to = |p: &Point3<f64>| Vector::new(p.x as f32, p.y as f32, p.z as f32);
            let theirs = query::distance(
                &Pose::IDENTITY, &Segment::new(to(&a), to(&b)),
                &Pose::IDENTITY, &ParryTriangle::new(to(&p), to(&q), to(&r)),
            ).expect("both shapes are supported").distance;
            let ours = segment_triangle_squared(&a, &b, &[p, q, r]).sqrt();
            prop_assert!((ours - f64::from(theirs)).abs() < 0.02, "ours {ours}, parry {theirs}");
        }
    }
}
