; {{ plan }}: {{ wire }}, {{ length_mm }} mm of wire {{ wire_diameter_mm }} mm thick, by {{ program }}
; X feeds the wire (mm): a straight and the arc after it, which the pin then bends about the nozzle;
; A turns the wire about itself (degrees); B bends it (degrees), and goes back
G21
G91
{% for bend in bends %}
; {{ bend.index }}{{ " " + bend.note if bend.note else "" }}
G1 X{{ bend.feed_mm + bend.arc_mm }} F1200
{% if bend.bend_deg %}
G1 A{{ bend.rotation_deg }} F3600
G1 B{{ bend.tool_angle_deg }} F1800
G1 B{{ -bend.tool_angle_deg }} F3600
{% endif %}
{% endfor %}
M2
