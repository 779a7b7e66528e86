"""What changing the arm would do to its vibration: sweeps, sensitivities, designs and their verification."""
