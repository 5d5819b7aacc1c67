"""Every list that the manuals print, with its figures as printed.

Elisions are included; line breaks of the page layout are undone. Manuals: [000] TF5200
parameters 1.24, [001] TF5200 functional description 1.51, [002] ISG parameter manual.
"""

CROSS_000 = """
    # ****************************************
    # Axis compensation data for Z-axis
    # ****************************************

    kopf.achs_nr                          3
    kopf.log_achs_name                    Z
    kw.crosscomp.last_index               99  /*Last valid index of the table*/
    kw.crosscomp.master_ax_nr             1   /*Log. ax. number of the master axis*/
    kw.crosscomp.unit                     1   /*0:Incr. 1:Metric in 0.1 µm*/
    kw.crosscomp.n_cycles                 10
    #
    kw.crosscomp.table[0].setpoint        10735
    kw.crosscomp.table[0].correction      3
    kw.crosscomp.table[1].setpoint        11523
    kw.crosscomp.table[1].correction      5
    :
    :
    kw.crosscomp.table[99].setpoint       10000000  /*at 1000 mm of axis 3*/
    kw.crosscomp.table[99].correction     1000      /*corr. of 0.1 mm for axis 1*/
"""
CROSS_001 = CROSS_000.replace("n_cycles                 10", "n_cycles 20")

PLANE_000 = """
    # ****************************************
    # Axis compensation data for Z-axis
    # ****************************************
    kopf.achs_nr                                     1
    kopf.log_achs_name                               X

    kw.crosscomp2.interval                           100000    /* 10 mm */
    kw.crosscomp2.last_index_master1                 100
    kw.crosscomp2.last_index_master2                 100
    kw.crosscomp2.start_position_master1            -400000    /* -40 mm */
    kw.crosscomp2.start_position_master2            -700000    /* -70 mm */
    kw.crosscomp2.unit                               1         /* 0.1 my */
    kw.crosscomp2.n_cycles                           10
    kw.crosscomp2.master1_ax_nr                      2
    kw.crosscomp2.master2_ax_nr                      3

    kw.crosscomp2.table[ 0][ 0].correction          -3
    kw.crosscomp2.table[ 0][ 1].correction          -1
    kw.crosscomp2.table[ 0][ 2].correction           4
    kw.crosscomp2.table[ 0][ 3].correction           9
    kw.crosscomp2.table[ 0][ 4].correction          13
    kw.crosscomp2.table[ 0][ 5].correction          17
    kw.crosscomp2.table[ 0][ 6].correction          42
    kw.crosscomp2.table[ 0][ 7].correction          53
    ...
    kw.crosscomp2.table[100][ 90].correction        82
    kw.crosscomp2.table[100][ 91].correction        77
    kw.crosscomp2.table[100][ 92].correction        68
    kw.crosscomp2.table[100][ 93].correction        63
    kw.crosscomp2.table[100][ 94].correction        61
    kw.crosscomp2.table[100][ 95].correction        59
    kw.crosscomp2.table[100][ 96].correction        57
    kw.crosscomp2.table[100][ 97].correction        52
    kw.crosscomp2.table[100][ 98].correction        56
    kw.crosscomp2.table[100][ 99].correction        58
    kw.crosscomp2.table[100][100].correction        49
    End
"""
PLANE_001_FIGURE = """
    kw.crosscomp2.interval 100000
    kw.crosscomp2.last_index_master1 7
    kw.crosscomp2.last_index_master2 6
    kw.crosscomp2.start_position_master1 220000
    kw.crosscomp2.start_position_master2 -160000
    kw.crosscomp2.unit 1
    kw.crosscomp2.master1_ax_nr 1
    kw.crosscomp2.master2_ax_nr 2
    kw.crosscomp2.table[0][0].correction 0
    ...
    kw.crosscomp2.table[6][7].correction 324
"""
PLANE_001_MAX_POINTS = """
    # ****************************************
    # Axis compensation data X axis
    # ****************************************
    kopf.achs_nr 1
    kopf.log_achs_name X
    # Reserve maximum number of table entries
    kw.crosscomp2.max_points 50000
    kw.crosscomp2.last_index_master1 1000
    kw.crosscomp2.last_index_master2 20
    kw.crosscomp2.table[ 0][ 0].correction -3
    kw.crosscomp2.table[ 0][ 1].correction -1
    etc.
    kw.crosscomp2.table[ 20][ 999].correction 58
    kw.crosscomp2.table[ 20][1000].correction 49
"""
PLANE_001_LARGE = """
    # ****************************************
    # Axis compensation data X axis
    # ****************************************
    kopf.achs_nr 1
    kopf.log_achs_name X
    kw.crosscomp2.interval 100000 /* 10 mm */
    kw.crosscomp2.last_index_master1 100
    kw.crosscomp2.last_index_master2 200
    kw.crosscomp2.start_position_master1 -400000 /* -40 mm */
    kw.crosscomp2.start_position_master2 -700000 /* -70 mm */
    kw.crosscomp2.unit 1 /* 0,1 mµ */
    kw.crosscomp2.master1_ax_nr 2
    kw.crosscomp2.master2_ax_nr 3
    kw.crosscomp2.n_cycles 20
    kw.crosscomp2.table[ 0][ 0].correction -3
    kw.crosscomp2.table[ 0][ 1].correction -1
    kw.crosscomp2.table[ 0][ 22].correction -99
    …
    kw.crosscomp2.table[200][ 71].correction 45
    kw.crosscomp2.table[200][ 80].correction 176
    kw.crosscomp2.table[200][ 99].correction 58
    kw.crosscomp2.table[200][100].correction 49
    # End
"""
LEADSCREW_000 = """
    kopf.log_achs_nr                     2
    kopf.log_achs_name                   Y-ACHSE
    kw.ssfk.interval                     0
    kw.ssfk.kw_startpos                 -200000
    kw.ssfk.kw_nr_max                    140
    kw.ssfk.unit                         1
    kw.ssfk.bilateral                    1
    kw.ssfk.table[0].setpoint           -200000
    kw.ssfk.table[1].setpoint           -199306
    kw.ssfk.table[2].setpoint           -198667
    kw.ssfk.table[3].setpoint           -198001
    ...
    kw.ssfk.table[138].setpoint          334488
    kw.ssfk.table[139].setpoint          335591
    kw.ssfk.table[0].pos                 0
    kw.ssfk.table[1].pos                 24
    kw.ssfk.table[2].pos                -102
    ...
    kw.ssfk.table[139].pos               -55
    kw.ssfk.table[0].neg                 0
    kw.ssfk.table[1].neg                 67
    kw.ssfk.table[2].neg                 80
    ...
    kw.ssfk.table[139].neg               114
"""
LEADSCREW_001 = LEADSCREW_000.replace("kopf.log_achs_nr ", "kopf.achs_nr ").replace(
    "Y-ACHSE", "Y AXIS"
)
FRICTION_001 = """
    frict_comp.mode 3
    frict_comp.table_entries 3
    frict_comp.position_delay 30
    frict_comp.reversal_lookahead 4
    frict_comp.scaling_factor 10
    frict_comp.delay_cycles 9
    frict_comp.table[0].in 0
    frict_comp.table[0].out 0
    frict_comp.table[1].in 316
    frict_comp.table[1].out 3722
    frict_comp.table[2].in 333
    frict_comp.table[2].out 3884
"""
CROSSTALK_MODE_1 = """
    # ****************************************
    # Axis compensation data for Z axis
    # ****************************************
    kopf.achs_nr 3
    kopf.log_achs_name Z
    kw.crosstalk.mode 1
    kw.crosstalk.master_dyn_ax_nr 1 /*Logical axis number of the master axis */
    kw.crosstalk.velocity_dependent TRUE
    #
    kw.crosstalk.acceleration 10000 ( mm/s^2)
    kw.crosstalk.deceleration -10000 ( mm/s^2)
    kw.crosstalk.position[0].correction_accelerate_dir_pos 25 (0.1 um)
    Kw.crosstalk.position[0].correction_decelerate_dir_pos 25
    Kw.crosstalk.position[0].correction_accelerate_dir_neg 50
    kw.crosstalk.position[0].correction_decelerate_dir_neg 50
"""
CROSSTALK_MODE_2 = """
    # ****************************************
    # Axis compensation data for Z axis
    # ****************************************
    kopf.achs_nr 3
    kopf.log_achs_name Z
    kw.crosstalk.mode 2
    kw.crosstalk.master_dyn_ax_nr 1 /*Logical axis number of the master axis */
    kw.crosstalk.velocity_dependent TRUE
    #
    kw.crosstalk.acceleration 1000 ( mm/s^2 )
    kw.crosstalk.deceleration -1000 ( mm/s^2 )
    kw.crosstalk.position[0].ax_1 0 (0.1 um )
    kw.crosstalk.position[0].correction_accelerate_dir_pos 50 (0.1 um)
    Kw.crosstalk.position[0].correction_decelerate_dir_pos 50
    Kw.crosstalk.position[0].correction_accelerate_dir_neg 60
    kw.crosstalk.position[0].correction_decelerate_dir_neg 60
    kw.crosstalk.position[1].ax_1 1000 (0.1 um)
    kw.crosstalk.position[1].correction_accelerate_dir_pos 70 (0.1 um)
    Kw.crosstalk.position[1].correction_decelerate_dir_pos 70
    Kw.crosstalk.position[1].correction_accelerate_dir_neg 80
    kw.crosstalk.position[1].correction_decelerate_dir_neg 80
    kw.crosstalk.position[2].ax_1 2000 ( 0.1 um)
    kw.crosstalk.position[2].correction_accelerate_dir_pos 50 (0.1 um)
    kw.crosstalk.position[2].correction_decelerate_dir_pos 50
    Kw.crosstalk.position[2].correction_accelerate_dir_neg 60
    kw.crosstalk.position[2].correction_decelerate_dir_neg 60
"""
CROSSTALK_MODE_3 = """
# ****************************************
# Axis compensation data for Z axis
# ****************************************
kopf.achs_nr 3
kopf.log_achs_name Z
kw.crosstalk.mode 3
kw.crosstalk.master_dyn_ax_nr 2 ( Logical axis number of the master axis )
kw.crosstalk.master_pos1_ax_nr 1 ( Logical axis number of the first adaptation axis )
kw.crosstalk.master_pos2_ax_nr 3 ( Logical axis number of the second adaptation axis )
kw.crosstalk.max_points 9 ( Number of measuring points)
kw.crosstalk.velocity_dependent TRUE
#
kw.crosstalk.acceleration_pos 1000 ( mm/s^2 )
kw.crosstalk.acceleration_neg -1000 ( mm/s^2 )
kw.crosstalk.position[0].ax_1 0 ( 0.1 um)
kw.crosstalk.position[0].ax_2 0 ( 0.1 um)
kw.crosstalk.position[0].acc_pos_vel_pos_correction 60 ( 0.1 um )
kw.crosstalk.position[0].acc_pos_vel_neg_correction 60
kw.crosstalk.position[0].acc_neg_vel_pos_correction 70
kw.crosstalk.position[0].acc_neg_vel_neg_correction 70
#…
#…
kw.crosstalk.position[8].ax_1 3000 ( 0.1 um )
kw.crosstalk.position[8].ax_2 3000 ( 0.1 um )
kw.crosstalk.position[8].acc_pos_vel_pos_correction 50 ( 0.1 um )
kw.crosstalk.position[8].acc_pos_vel_neg_correction 50
kw.crosstalk.position[8].acc_neg_vel_pos_correction 60
kw.crosstalk.position[8].acc_neg_vel_neg_correction 60
"""
START_UP_001 = """
    :
    zahl_kw 3
    #
    achs_kw_log_ax_nr[0] 1
    achs_kw[0] ..\\listen\\achskw1.lis
    #
    achs_kw_log_ax_nr[1] 2
    achs_kw[1] ..\\listen\\achskw2.lis
    #
    achs_kw_log_ax_nr[2] 6
    achs_kw[2] ..\\listen\\achskw6.lis
    :
"""
BACKLASH_001 = """
    getriebe[0].lose 1000 #0,1 µm backlash
    lr_param.anwahl_losekomp 1 #Positive direction
    lr_param. n_backlash_cyc 10 #Number of filter cycles
"""
TEMPERATURE_001_P17 = """
    kopf.achs_nr 1
    #
    # temperature compensation on/off
    lr_param.temp_comp 1
    # reference position
    lr_param.temp_comp_position_0 100 [0.1µm]
    # reference offset
    lr_param.temp_comp_offset_0 40 [0.1µm]
    lr_param.temp_comp_coefficient 4000 [µm/m]
    #
"""
TEMPERATURE_001_P18 = """
    kopf.achs_nr 1
    #
    # Cycle of the sin² filter
    lr_param.temp_comp_n_cycles 20
"""
MONITORING_001 = """
    lr_param.prog_movement_requires_compensations LEAD | CROSS
    lr_param.ssfk 1
    lr_param.crosscomp 1
"""
COMMENTS_002 = """
    # ************************************************************************
    # Data
    # ************************************************************************
    #
    # List comments after numerical values

    dummy[1] 1 Comment
    dummy[2] 1 # Comment
    dummy[3] 1 ( Comment
    dummy[4] 1 /* Comment
    ...
    ...
    # List comments after strings

    beispiel[0].bezeichnung STRING_1 (comment requires a '(‘ bracket!)

    beispiel[1].bezeichnung″ STRING_(2)″ (comment requires a '(‘ bracket!)
    example[0].name ″STRING_WITH_COMMENT( # /*)_CHARACTERS″
    example[0].name STRING_WITH_STANDARD_CHARACTERS!
"""  # noqa: RUF001
