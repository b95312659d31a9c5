//! A robot with two arms, and whether two campaigns are the same.

use misfit_campaign::Campaign;

/// A torso with two arms; one of them slides.
pub const TWO_ARMS: &str = r#"<robot name="two_arms">
  <link name="base"/>
  <joint name="torso" type="revolute"><parent link="base"/><child link="trunk"/><origin xyz="0 0 1" rpy="0 0 0.1"/><axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="9" velocity="1"/></joint>
  <link name="trunk"/>
  <joint name="slide" type="prismatic"><parent link="trunk"/><child link="left_arm"/><origin xyz="0 0.2 0" rpy="0.3 0 0"/><axis xyz="1 0 0"/><limit lower="0" upper="1" effort="9" velocity="1"/></joint>
  <link name="left_arm"/>
  <joint name="left_mount" type="fixed"><parent link="left_arm"/><child link="left_flange"/><origin xyz="0 0 0.1" rpy="0 0.2 0"/></joint>
  <link name="left_flange"/>
  <joint name="wrist" type="revolute"><parent link="trunk"/><child link="right_flange"/><origin xyz="0 -0.2 0"/><axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="9" velocity="1"/></joint>
  <link name="right_flange"/>
</robot>"#;

/// The same kinematics do not matter: a DH table as the other kind of robot file.
pub const DH_TABLE: &str = "name = \"dh\"\nconvention = \"standard\"\n\
    [[joint]]\nname = \"j1\"\nalpha_deg = 90\nd_mm = 243\n\
    [[joint]]\nname = \"j2\"\na_mm = 70\n";

/// Equal to the last bit: `==` alone takes -0 for 0.
#[track_caller]
pub fn assert_same(left: &Campaign, right: &Campaign) {
    assert_eq!(left, right);
    // Debug output tells the zeros apart.
    assert_eq!(format!("{left:?}"), format!("{right:?}"));
}
