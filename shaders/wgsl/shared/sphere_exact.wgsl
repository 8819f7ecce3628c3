// Whether two spheres meet, exactly, in integers. Why it is exact, and mirror: `mirror/sphere_exact.rs`.

#import order_keys

const DIGIT_BITS: u32 = 11u;
const DIGIT: u32 = 2047u;
// Digits of the difference of two f32, regardless of what they are.
const MOST_DIGITS: u32 = 26u;

// Magnitude in units of 2^(shift - 149).
fn mantissas(bits: vec4<u32>) -> vec4<u32> {
    let is_normal = (bits & vec4<u32>(INFINITY_BITS)) != vec4<u32>(0u);
    return (bits & vec4<u32>(0x7fffffu)) | select(vec4<u32>(0u), vec4<u32>(0x800000u), is_normal);
}

fn shifts(bits: vec4<u32>) -> vec4<u32> {
    return max((bits >> vec4<u32>(23u)) & vec4<u32>(255u), vec4<u32>(1u)) - vec4<u32>(1u);
}

// Digit of mantissa * 2^up that weighs 2^low.
fn digit(mantissa: u32, up: u32, low: u32) -> i32 {
    let right = (mantissa >> min(low - up, 31u)) & DIGIT;
    let left = (mantissa << min(up - low, 31u)) & DIGIT;
    return i32(select(left, right, low >= up));
}

fn digits(mantissa: vec4<u32>, up: vec4<u32>, low: u32, sign: vec4<i32>) -> vec4<i32> {
    return sign * vec4<i32>(
        digit(mantissa.x, up.x, low),
        digit(mantissa.y, up.y, low),
        digit(mantissa.z, up.z, low),
        digit(mantissa.w, up.w, low),
    );
}

// Spheres as `grid_cells` and `keys` leave them: a radius with a sign overlaps nothing.
fn do_spheres_meet(a: vec4<u32>, b: vec4<u32>) -> bool {
    if (((a.w | b.w) & SIGN_BIT) != 0u) {
        return false;
    }
    if (max(a.w, b.w) >= INFINITY_BITS) {
        return true;
    }
    let a_mantissas = mantissas(a);
    let b_mantissas = mantissas(b);
    let a_shifts = shifts(a);
    let b_shifts = shifts(b);
    // The lowest and the highest shift of what is not 0.
    let a_is = a_mantissas != vec4<u32>(0u);
    let b_is = b_mantissas != vec4<u32>(0u);
    let none = vec4<u32>(254u);
    let lows = min(select(none, a_shifts, a_is), select(none, b_shifts, b_is));
    let highs = max(select(vec4<u32>(0u), a_shifts, a_is), select(vec4<u32>(0u), b_shifts, b_is));
    let low = min(min(lows.x, lows.y), min(lows.z, lows.w));
    let high = max(max(highs.x, highs.y), max(highs.z, highs.w));
    if (low == 254u) {
        // Two points at the origin.
        return true;
    }
    let count = min((high - low + 34u) / DIGIT_BITS, MOST_DIGITS);

    // Digits of x1 - x2, y1 - y2, z1 - z2 and r1 + r2. They may be negative.
    let negative = vec4<i32>(-1);
    let positive = vec4<i32>(1);
    let signed_a = select(positive, negative, (a & vec4<u32>(SIGN_BIT)) != vec4<u32>(0u));
    let signed_b = select(positive, negative, (b & vec4<u32>(SIGN_BIT)) != vec4<u32>(0u))
        * vec4<i32>(-1, -1, -1, 1);
    let a_up = select(vec4<u32>(0u), a_shifts - vec4<u32>(low), a_is);
    let b_up = select(vec4<u32>(0u), b_shifts - vec4<u32>(low), b_is);
    var number: array<vec4<i32>, MOST_DIGITS>;
    for (var i = 0u; i < count; i++) {
        let weight = DIGIT_BITS * i;
        number[i] = digits(a_mantissas, a_up, weight, signed_a)
            + digits(b_mantissas, b_up, weight, signed_b);
    }

    // x^2 + y^2 + z^2 - r^2, a digit of the result at a time.
    var carry = 0;
    var is_zero = true;
    for (var k = 0u; k < 2u * count - 1u; k++) {
        let first = max(k + 1u, count) - count;
        let last = min(k, count - 1u);
        for (var i = first; i <= last; i++) {
            let product = number[i] * number[k - i];
            carry += product.x + product.y + product.z - product.w;
        }
        is_zero = is_zero && (carry & i32(DIGIT)) == 0;
        carry = carry >> DIGIT_BITS;
    }
    return carry < 0 || (carry == 0 && is_zero);
}
