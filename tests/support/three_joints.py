"""Robots of three oblique joints as MJCF and URDF, and their bushings."""

MJCF = """\
<mujoco model="three">
  <compiler angle="degree" autolimits="true"/>
  <option gravity="0 0 -9.80665"/>
  <default><joint axis="0 1 0" armature="0.1" damping="200"/><geom type="capsule" density="1000"/></default>
  <asset><mesh name="nowhere" file="nowhere.obj"/><material name="grey" rgba="1 1 1 1"/></asset>
  <worldbody>
    <body name="stand" pos="0.1 0 0.3" euler="0 0 20">
      <inertial mass="99" pos="0 0 0" diaginertia="1 1 1"/>
      <body name="a" pos="0 0.05 0.2" euler="5 -10 15">
        <inertial mass="7" pos="0.3 0.1 0" fullinertia="0.3 0.4 0.5 0.01 0.02 0.03"/>
        <joint name="j1" pos="0.02 0 0.01" axis="0 0 2" range="-60 120"/>
        <geom type="mesh" mesh="nowhere" material="grey"/>
        <body name="b" pos="0.6 0 0.1" axisangle="1 0 0 90">
          <inertial mass="5" pos="0 0.2 0.1" diaginertia="0.2 0.1 0.2"/>
          <joint name="j2" limited="false"/>
          <geom name="shell" type="mesh" mesh="nowhere"/>
          <body name="motor" pos="0 0 0.3" euler="0 17 0"><geom size="0.03 0.1" material="grey"/></body>
          <body name="c" pos="0.2 0 0.4" euler="0 0 57">
            <inertial mass="1.5" pos="0.1 0 0" diaginertia="0.01 0.02 0.02"/>
            <frame euler="10 0 0"><joint name="j3" axis="1 0.5 0.2" range="-57 57"/></frame>
            <body name="flange" pos="0.25 0 0"><site name="tool" pos="0 0 0.1"/></body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator><motor joint="j1"/></actuator>
  <keyframe><key qpos="1 2 3"/></keyframe>
</mujoco>
"""
WITHOUT_MESHES = "\n".join(line for line in MJCF.splitlines() if "nowhere" not in line).replace(' material="grey"', "")
"""The same, which MuJoCo reads by itself."""

JOINTS = """\
format = "ident-joints/1"
[[joint]]
name = "j1"
k_bend = { value = 2000, unit = "N*m/deg", origin = "datasheet" }
k_tors = { value = 1e5, unit = "N*m/rad", origin = "assumed" }
tau_tors = { value = 1, unit = "ms", origin = "measured" }
[[joint]]
name = "j2"
k_bend = { value = 2e5, unit = "N*m/rad", origin = "assumed" }
k_tors = { value = 8e4, unit = "N*m/rad", origin = "assumed" }
[[joint]]
name = "j3"
k_bend = { value = 5e4, unit = "N*m/rad", origin = "assumed" }
k_tors = { value = 3e4, unit = "N*m/rad", origin = "assumed" }
[[point]]
name = "elbow"
joint = "j2"
position = { value = [0, 0, 10], unit = "mm", origin = "measured" }
"""

URDF = """\
<?xml version="1.0"?>
<robot name="three">
  <link name="base"><inertial><mass value="99"/>
    <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="mount" type="fixed">
    <parent link="base"/><child link="stand"/><origin xyz="0.1 0 0.3" rpy="0 0 0.4"/></joint>
  <link name="stand"/>
  <joint name="j1" type="revolute">
    <parent link="stand"/><child link="a"/><origin xyz="0 0.05 0.2" rpy="0.1 -0.2 0.3"/>
    <axis xyz="0 0 2"/><limit lower="-1" upper="2" effort="1" velocity="1"/></joint>
  <link name="a"><inertial><origin xyz="0.3 0.1 0" rpy="0.5 0.6 0.7"/><mass value="7"/>
    <inertia ixx="0.3" iyy="0.4" izz="0.5" ixy="0.01" ixz="0.02" iyz="0.03"/></inertial>
    <visual><geometry><mesh filename="package://nowhere/a.stl"/></geometry></visual></link>
  <joint name="j2" type="continuous">
    <parent link="a"/><child link="b"/><origin xyz="0.6 0 0.1" rpy="1.5707963267948966 0 0"/>
    <axis xyz="0 1 0"/></joint>
  <link name="b"><inertial><origin xyz="0 0.2 0.1"/><mass value="5"/>
    <inertia ixx="0.2" iyy="0.1" izz="0.2" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="bolted" type="fixed">
    <parent link="b"/><child link="motor"/><origin xyz="0 0 0.3" rpy="0 0.3 0"/></joint>
  <link name="motor"><inertial><mass value="2"/>
    <inertia ixx="0.02" iyy="0.02" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="j3" type="revolute">
    <parent link="motor"/><child link="c"/><origin xyz="0.2 0 0.1" rpy="0 0 1"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <link name="c"><inertial><origin xyz="0.1 0 0" rpy="0 0 1"/><mass value="1.5"/>
    <inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="flange" type="fixed">
    <parent link="c"/><child link="tool0"/><origin xyz="0.25 0 0"/></joint>
  <link name="tool0"/>
</robot>
"""
"""Another robot of three joints, with fixed ones between them, as URDF."""

INERTIAL = """<inertial><origin xyz="{at}" rpy="0.3 0 0.1"/><mass value="{mass}"/>
    <inertia ixx="{i}" iyy="{i}" izz="{i}" ixy="0" ixz="0" iyz="0"/></inertial>"""
HAND = f"""
  <joint name="wrist" type="fixed"><parent link="tool0"/><child link="hand"/>
    <origin xyz="0 0 0.1" rpy="0 0.4 0"/></joint>
  <link name="hand">{INERTIAL.format(at="0.01 0 0.05", mass=0.7, i=0.001)}</link>
  <joint name="slide_l" type="prismatic"><parent link="hand"/><child link="finger_l"/>
    <origin xyz="0 0.02 0.1" rpy="0.2 0 0"/><axis xyz="0 1 0"/>
    <limit lower="0" upper="0.04" effort="1" velocity="1"/></joint>
  <link name="finger_l">{INERTIAL.format(at="0 0.01 0.02", mass=0.11, i=1e-4)}</link>
  <joint name="glue" type="fixed"><parent link="finger_l"/><child link="pad"/><origin xyz="0 0 0.05"/></joint>
  <link name="pad">{INERTIAL.format(at="0 0 0", mass=0.02, i=1e-5)}</link>
  <joint name="slide_r" type="prismatic"><parent link="hand"/><child link="finger_r"/><origin xyz="0 -0.02 0.1"/>
    <axis xyz="0 -1 0"/><mimic joint="slide_l"/><limit lower="0" upper="0.04" effort="1" velocity="1"/></joint>
  <link name="finger_r">{INERTIAL.format(at="0 -0.01 0.02", mass=0.12, i=1e-4)}</link>
  <joint name="cable" type="floating"><parent link="b"/><child link="hose"/><origin xyz="0 0.1 0"/></joint>
  <link name="hose">{INERTIAL.format(at="0 0 0.2", mass=0.4, i=0.01)}</link>
  <joint name="table" type="planar"><parent link="base"/><child link="box"/><axis xyz="0 0 1"/></joint>
  <link name="box">{INERTIAL.format(at="0 0 0", mass=30, i=2)}</link>
</robot>"""
WITH_HAND = URDF.replace("</robot>", HAND)
"""The same robot with a hand of two sliding fingers, a hose and a table."""
